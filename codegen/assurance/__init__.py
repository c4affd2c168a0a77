"""The assurance file of an observer, ``assurance.json``: from the plant file to the lines of C, claim by claim.

Written by ``residua run`` and ``residua generate``; ``validate``, ``prove``, ``fuzz`` and ``target`` enter their
results (one step: a new file is renamed over the old). ``residua assurance DIR`` states it anew from design.json and
the C and refuses any difference. It names no date: the same design, C and tools give the same bytes. Format 1::

    format, tool      1, "residua <version>"
    state             "current", or "stale: <why>": the claims are not about the C beside the file
    design            plant, method, family, real, layout, prefix; certificate and plant_sha256 are sha256
    files             sha256 of design.json, <prefix>.c, <prefix>.h when this was stated
    claims            id; claim (sentence); plant [{entry: path in the TOML, line}];
                      condition {words, formula, source, code: function that decides it};
                      margins [{what, margin: what is left, rounded down; expected ">= 0" or "> 0"; where}];
                      constants [name]; lines {file: [[first, last]]}; checks [id]
    constants         name, mode ("" for all), file, function, entries [{index, value, literal, lines}]:
                      value is exact; literal is as the C writes it, without its sign, "" for a product with 1
                      (lines are the operand's) or with 0 (not written: no line)
    checks            id, what, command, tool; state "not run", "passed", "failed" or "stale" (a file that it ran on has
                      changed since); figures; ran_on {file: sha256}

``places`` finds the lines: it parses the C and executes it with symbols (``c_reader``, ``symbolic``), so a constant is
located by what it multiplies, not by how it looks; ``read_varying`` does so where coefficients depend on parameters
(``M_theta`` are slopes, index [parameter, row, column]) or radii move the bounds apart, ``point_places`` reads the sets
of point observers table by table, ``own_places`` filters and mode estimators. ``claims`` and ``margins`` state the
conditions, ``filter_claims`` and ``mode_claims`` those of the families with claims of their own (``claims.OWN``),
``point_claims`` and ``point_margins`` those of sets (a new kind needs an entry in the dicts of both, and in
``emit.set_ranges`` if its state has words of its own), ``plant_lines`` finds the plant's entries, ``checks`` knows the
commands, ``statement`` puts all that together, ``document`` is the file.
"""
