# Two commands do all the set-up: `make demo` and `make test`. Everything lands in .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO := examples/roboracer

.PHONY: demo test test-fast lint docs clean help

help:
	@echo "make demo       set up, then run the RoboRacer example from ROS graph to verified schedule and reports"
	@echo "make test       set up, then run the linters and all tests"
	@echo "make test-fast  the tests without the slow ones"
	@echo "make docs       regenerate the reference pages from the code"

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "halpipe needs Python 3.11 or newer; set PYTHON=/path/to/python3.11"; exit 1; }
	@$(PYTHON) -m venv $(VENV) || \
	  { rm -rf $(VENV); echo "cannot create a virtual environment; on Debian: apt-get install python3-venv"; exit 1; }

$(VENV)/.demo-ready: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e .
	@touch $@

$(VENV)/.test-ready: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev,exact,cluster]'
	@touch $@ $(VENV)/.demo-ready

demo: $(VENV)/.demo-ready
	$(BIN)/halpipe run $(DEMO)/pipeline.yaml
	@command -v dot >/dev/null && $(BIN)/halpipe export graph $(DEMO)/out/model.xml $(DEMO)/out/schedule.xml -o $(DEMO)/out/graph.svg || \
	  echo "graph.svg skipped: the dot program is missing (Debian: apt-get install graphviz); graph.dot is there"
	@echo
	@echo "Look at:"
	@echo "  $(DEMO)/out/report.html    the schedule of every mode, as a page for any browser"
	@echo "  $(DEMO)/out/schedule.xml   the verified schedule"
	@echo "  $(DEMO)/out/model.xml      the task model made from the ROS graph and overlay.yaml"
	@echo "  $(DEMO)/out/graph.dot      its dependencies; trace.json opens in ui.perfetto.dev"

lint: $(VENV)/.test-ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

test: lint
	$(BIN)/pytest

test-fast: $(VENV)/.test-ready
	$(BIN)/pytest -m "not slow"

docs: $(VENV)/.test-ready
	$(BIN)/python docs/generate.py

clean:
	rm -rf $(VENV) build dist $(DEMO)/out
