"""Templates decide nothing: no conditions, no arithmetic, no comparison, no number formatting."""

import pytest
from jinja2 import nodes

from codegen.emit.render import environment, render, template_root
from codegen.errors import EmitError

ALLOWED = (nodes.Template, nodes.Output, nodes.TemplateData, nodes.Name, nodes.Const, nodes.Getattr, nodes.For,
           nodes.Extends, nodes.Block, nodes.Import, nodes.Macro, nodes.Call, nodes.Filter)
FILTERS = {"join", "length"}
TEMPLATES = sorted(p.relative_to(template_root()).as_posix() for p in template_root().rglob("*.jinja")
                   if "report" not in p.parts)


def offences(source):
    tree = environment().parse(source)
    found = []
    for node in tree.iter_child_nodes():
        found += [n for n in (node, *node.find_all(nodes.Node)) if not isinstance(n, ALLOWED)]
    found += [n for n in tree.find_all(nodes.Filter) if n.name not in FILTERS]
    found += [n for n in tree.find_all(nodes.For) if n.test or n.else_ or n.recursive]
    # A call is a macro of ours, by its name or through an import: never a method of a value.
    macros = {m.name for m in tree.find_all(nodes.Macro)}
    imports = {i.target for i in tree.find_all(nodes.Import)}
    for call in tree.find_all(nodes.Call):
        own = isinstance(call.node, nodes.Name) and call.node.name in macros
        imported = (isinstance(call.node, nodes.Getattr) and isinstance(call.node.node, nodes.Name)
                    and call.node.node.name in imports)
        found += [] if own or imported else [call]
    return found


@pytest.mark.parametrize("name", TEMPLATES)
def test_only_the_allowed_constructs(name):
    assert not offences((template_root() / name).read_text())


@pytest.mark.parametrize("source", [
    "{% if a %}{% endif %}", "{{ a + 1 }}", "{{ a == 1 }}", "{{ a | round }}", "{{ a.update() }}", "{{ a[0] }}",
    "{{ a is defined }}", "{{ a if b else c }}", "{% set a = 1 %}", "{{ '%f' | format(a) }}", "{{ a ~ b }}",
    "{% for a in b if a %}{% endfor %}", "{% include 'x' %}", "{{ not a }}", "{{ -a }}", "{{ a and b }}"])
def test_the_rule_notices(source):
    assert offences(source)


def test_there_are_templates():
    assert {"observer.h.jinja", "observer.c.jinja", "interval.c.jinja", "tnl.c.jinja"} <= set(TEMPLATES)


def test_an_undefined_name_is_an_error():
    with pytest.raises(EmitError, match="observer.h.jinja: UndefinedError"):
        render("observer.h.jinja", d=object())
    with pytest.raises(EmitError, match="none.jinja: TemplateNotFound"):
        render("none.jinja")
