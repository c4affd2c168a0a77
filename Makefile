# Two commands do everything: `make demo` and `make test`.
PYTHON ?= python3
VENV   ?= .venv
BIN     = $(VENV)/bin
OUT    ?= demo

.PHONY: demo test lint generated bench clean

demo: $(VENV)/.installed
	$(BIN)/residua run emps -o $(OUT)/emps_tnl-interval
	$(BIN)/residua replay $(OUT)/emps_tnl-interval codegen/gallery/data/emps_train.csv -o $(OUT)/replay_train
	$(BIN)/residua replay $(OUT)/emps_tnl-interval codegen/gallery/data/emps_pulses.csv -o $(OUT)/replay_pulses
	@echo
	@echo "firmware: $(OUT)/emps_tnl-interval/emps.h and emps.c"
	@echo "report:   $(OUT)/emps_tnl-interval/report.html"
	@echo "replays:  $(OUT)/replay_train and $(OUT)/replay_pulses (bounds.csv and a plot each)"

test: $(VENV)/.tested
	$(BIN)/python -m pytest -n 2 --dist loadfile

lint: $(VENV)/.tested
	$(BIN)/ruff check codegen tests c_tests benchmarks

# Design the gallery anew and rewrite generated/; review the diff.
generated: $(VENV)/.installed
	$(BIN)/python generated/make.py

# Measure our layouts against other generators; half an hour. Writes benchmarks/RESULTS.md.
bench: $(VENV)/.tested
	$(BIN)/pip install -q -e '.[bench]'
	$(BIN)/python -m benchmarks

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "residua needs Python 3.11 or newer; found: $$($(PYTHON) --version). Set PYTHON=..."; exit 1; }
	@command -v gcc >/dev/null || { echo "gcc is missing. Install it: apt-get install gcc"; exit 1; }
	$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); \
	  echo "Python cannot make virtual environments here. Install them: apt-get install python3-venv"; exit 1; }

$(VENV)/.installed: pyproject.toml | $(VENV)/bin/python
	$(BIN)/pip install -q -e .
	@touch $@

$(VENV)/.tested: $(VENV)/.installed
	$(BIN)/pip install -q -e '.[test]'
	@touch $@

clean:
	rm -rf $(VENV) $(OUT) dist build *.egg-info
