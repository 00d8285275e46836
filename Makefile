# `make` alone lists what there is.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
READY := $(VENV)/.ready
COMPILED := $(VENV)/.compiled
SOURCES := $(wildcard mission/common/*.py mission/stand/*.py companion/core/*.py companion/core/*/*.py companion/core/*/*/*.py companion/mavlink/*.py companion/mavlink/*/*.py companion/journal/*.py companion/journal/*/*.py companion/sensors/*.py companion/survey/*.py \
  sim_bridge/world/*.py sim_bridge/world/*/*.py sim_bridge/world/*/*/*.py sim_bridge/drive/*.py sim_bridge/drive/*/*.py sim_bridge/judge/*.py sim_bridge/lab/study/ours.py sim_bridge/trunk_attenuation.py)
DEV_READY := $(VENV)/.ready-dev
MISSION ?= mission/examples/lone_tree.toml
FLY ?=

.PHONY: help install pure fly test dev fuzz taken-out mutants coverage check bench referees other-simulators conformance table1 bundle board-test docs dialect page page-parts page-check site site-parts site-check lock clean

help:
	@echo "make fly      set everything up, fly 8 vehicles to a tree     (MISSION=... FLY='-n 4 --seed 2')"
	@echo "make test     set everything up, run all tests on all cores"
	@echo "make fuzz     forged frames, files and flights, then the property tests with many more examples, others each time"
	@echo "              (EXECUTIONS=1000000 TIMES=20 SEED=...; one part alone: python -m tests.fuzz --help)"
	@echo "make taken-out each defence of docs/reference/hazards.md taken out in a copy: does a test of it fail"
	@echo "make mutants  small changes to filter, election, trust, radio and orders: does a test fail (an hour; EACH=120 OF=25)"
	@echo "make coverage the tests of the core alone, and how many of its branches they see"
	@echo "make check    lint, types, import contracts, unused code, lengths, words, generated files"
	@echo "make conformance  our autopilots against recorded flights of PX4 and ArduCopter"
	@echo "make bench    the figures of docs/reference/figures.md, measured here and now"
	@echo "make referees tests that others wrote, flown by ours, into docs/reference/referees.md"
	@echo "make other-simulators  our speed beside theirs, each in an environment of its own (2 GB, once)"
	@echo "make bundle   dist/understory-VERSION-linux.tar.gz, to install on boards without a network"
	@echo "make board-test  the bundle on an emulated arm64 board (Debian, as root; some minutes)"
	@echo "make table1   the paper's Table I, Figures 4 and 5 beside ours  (docs/paper/, runs/table1/)"
	@echo "make install  only set up .venv and compile, without the tools of the tests"
	@echo "make dev      the same, and the tools of the tests and benches: what python -m tests.bench and docs/reliability.md want"
	@echo "make pure     remove what was compiled"
	@echo "make docs     generate the reference from the code"
	@echo "make page     build the pages of replay and companion watch anew (npm)"
	@echo "make page-check  lint and unit tests of the pages; are the committed ones what their sources build to (npm)"
	@echo "make site     the documentation as static pages, with a swarm that flies in the browser: dist/site (npm, node)"
	@echo "make site-check  the same, and what its page flies, in Chromium, beside the same flight without a browser"
	@echo "make dialect  generate what is made of companion/mavlink/schema"
	@echo "make lock     resolve requirements*.lock anew"

install: $(COMPILED)
	@echo "installed: $(BIN)/sim-bridge, $(BIN)/companion, $(BIN)/mission"

$(READY): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or newer is needed; $(PYTHON) is $$($(PYTHON) -V). Try: make PYTHON=python3.12 ..."; exit 1; }
	@$(PYTHON) -m venv $(VENV) || \
	  { rm -rf $(VENV); echo "python3 -m venv failed. On Debian and Ubuntu: sudo apt install python3-venv"; exit 1; }
	@echo "installing into $(VENV): a minute or so, once"
	@$(PIP) --require-hashes -r requirements.lock
	@UNDERSTORY_PURE=1 $(PIP) --no-deps --no-build-isolation -e .
	@touch $@

# Without a compiler this prints why, and everything runs as pure Python.
$(COMPILED): $(READY) setup.py $(SOURCES)
	@echo "compiling: two minutes the first time, with a compiler, more on a busy computer; the programs fly as they are meanwhile"
	@$(BIN)/python setup.py --quiet build_ext --inplace
	@$(BIN)/python -m compileall -q mission companion sim_bridge
	@! ls mission/common/*.sums >/dev/null 2>&1 || touch $@

dev: $(COMPILED) $(DEV_READY)
	@echo "installed: $(BIN)/python -m tests.bench, $(BIN)/python -m pytest"

pure:
	find mission companion sim_bridge -name '*.so' -delete
	rm -rf mission/common/*.sums build/mypyc $(COMPILED)

$(DEV_READY): $(READY) requirements-dev.lock
	@echo "installing the tools of the tests into $(VENV): another minute or two, once"
	@$(PIP) --require-hashes -r requirements-dev.lock
	@touch $@

# Not compiled first: a visitor sees a swarm fly two minutes earlier, and it is the same flight.
fly: $(READY)
	@test -e $(COMPILED) || echo "flying pure Python; make install compiles what flies, for more speed"
	$(BIN)/sim-bridge fly $(MISSION) --map --open $(FLY)

# Swarms fly compiled, which takes about half of the time; those of these tests that need the sources run with the others.
# Those of tests/interop mostly wait for the wall clock: many side by side, when the others no longer need the cores. Real
# time on a computer that is busy with others' work may fail them all the same: such are tried once more, each by itself.
FLIGHTS := tests/scenario tests/study tests/report
SIDE_BY_SIDE := -m pytest -n logical --dist worksteal
# Else each process, of which tests start hundreds, compiles all that it imports.
unexport PYTHONDONTWRITEBYTECODE

test: coverage $(COMPILED) $(DEV_READY)
	$(BIN)/python $(SIDE_BY_SIDE) -m "not compiled" $(CORE_TESTS:%=--ignore %) --ignore tests/interop
	UNDERSTORY_PURE= $(BIN)/python $(SIDE_BY_SIDE) $(FLIGHTS)
	$(BIN)/python -m pytest -n 6 --dist loadscope tests/interop || \
	  $(BIN)/python -m pytest --last-failed --last-failed-no-failures none tests/interop

TIMES ?= 20
EXECUTIONS ?= 1000000
SEED ?= $(shell date +%s)

fuzz: $(DEV_READY)
	$(BIN)/python -m tests.fuzz --seed $(SEED) --executions $(EXECUTIONS)
	FUZZ=$(TIMES) $(BIN)/python $(SIDE_BY_SIDE) tests/property

taken-out: $(DEV_READY)
	$(BIN)/python -m tests.mutants taken-out

EACH ?= 120
OF ?= 25
MUTANTS := .venv-mutants

mutants: $(DEV_READY) $(MUTANTS)/.ready
	$(BIN)/python -m tests.mutants mutants --python $(MUTANTS)/bin/python --each $(EACH) --seed $(OF)

# mutmut in an environment of its own, beside which it finds what the tests need.
$(MUTANTS)/.ready: tests/mutants/mutmut.lock $(DEV_READY)
	@echo "installing mutmut into $(MUTANTS): half a minute, once"
	@$(BIN)/python -m venv $(MUTANTS)
	@$(MUTANTS)/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes -r $<
	@$(BIN)/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))' \
	  > $$($(MUTANTS)/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/project.pth
	@touch $@

# The core, part by part, with its branches counted: where too few of them are seen, it fails. Of the
# other tests nothing is counted: they fly whole swarms or start programs, and would take much longer.
CORE_TESTS := tests/unit/core tests/property/test_core_rule5.py tests/property/test_core_movement.py

coverage: $(COMPILED) $(DEV_READY)
	$(BIN)/python $(SIDE_BY_SIDE) $(CORE_TESTS) --cov --cov-report=term

check: $(DEV_READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/vulture
	$(BIN)/python -m tests.gates.file_length
	$(BIN)/python -m tests.gates.words
	$(BIN)/python -m tests.gates.package_size
	$(BIN)/python -m companion.mavlink.schema --check
	$(BIN)/python docs/generate.py --check

bench: $(COMPILED) $(DEV_READY)
	$(BIN)/python -m tests.bench --write docs/reference/figures.md

referees: $(COMPILED) $(DEV_READY)
	$(BIN)/python -m tests.referees --write docs/reference/referees.md

OTHER_SIMULATORS := crazyflow pyflyt rotorpy

other-simulators: $(COMPILED) $(DEV_READY) $(OTHER_SIMULATORS:%=.venv-other-simulators/%/.ready)
	$(BIN)/python -m tests.bench other-simulators

.venv-other-simulators/%/.ready: tests/bench/other_simulators/%.lock
	@echo "installing $* into .venv-other-simulators/$*: a minute or more, once"
	@$(PYTHON) -m venv .venv-other-simulators/$*
	@.venv-other-simulators/$*/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes -r $<
	@touch $@

bundle: $(READY)
	$(BIN)/python companion/board/bundle.py

board-test: $(READY)
	$(BIN)/python -m tests.board $(if $(WRITE),--write $(WRITE))

conformance: $(COMPILED)
	$(BIN)/sim-bridge conformance --write docs/reference/conformance.md

table1: $(COMPILED)
	$(BIN)/python -m sim_bridge.lab.paper.table1 --again --docs docs/paper

docs: $(DEV_READY)
	$(BIN)/python docs/generate.py

dialect: $(READY)
	$(BIN)/python -m companion.mavlink.schema

WEB := sim_bridge/judge/page/web

$(WEB)/node_modules/.ready: $(WEB)/package.json $(WEB)/package-lock.json
	cd $(WEB) && npm ci --no-audit --no-fund
	@touch $@

page-parts: $(WEB)/node_modules/.ready

page: page-parts
	cd $(WEB) && npm run build

page-check: page-parts
	cd $(WEB) && npm run lint && npm test && npm run check

# The pages' generator in an environment of its own.
SITE := .venv-site

$(SITE)/.ready: docs/website/site.lock
	@echo "installing the site's generator into $(SITE): some seconds, once"
	@$(PYTHON) -m venv $(SITE)
	@$(SITE)/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes -r $<
	@touch $@

build/site-wheels/.ready: docs/website/browser.lock $(READY)
	$(BIN)/python -m docs.website.build --fetch
	@touch $@

# Beside the pages' folder, and not in it: what packages bring of Markdown is no page of ours.
build/site-npm/.ready: $(addprefix docs/website/,package.json package-lock.json .npmrc)
	mkdir -p $(@D)
	cp $^ $(@D)
	cd $(@D) && npm ci
	@touch $@

# What a site is built of, and comes over a network.
site-parts: $(READY) $(SITE)/.ready build/site-wheels/.ready build/site-npm/.ready

site: site-parts
	$(BIN)/python -m docs.website.build dist/site --zensical $(abspath $(SITE))/bin/zensical

site-check: site $(DEV_READY)
	SITE=$(abspath dist/site) $(BIN)/python -m pytest tests/site

COMPILE := $(BIN)/uv pip compile --universal --python-version 3.11 --generate-hashes --no-strip-extras --quiet --no-emit-index-url \
  --custom-compile-command 'make lock'

# Without rerun, whose 250 MB one test wants, which is skipped where they are not.
DEV_EXTRAS := sim edit cluster pandas ros2 zenoh build dev

lock: $(DEV_READY)
	$(COMPILE) pyproject.toml --extra sim --extra edit --extra build -o requirements.lock
	$(COMPILE) pyproject.toml --extra survey companion/board/installer.in -c requirements.lock -o requirements-board.lock
	$(COMPILE) pyproject.toml $(DEV_EXTRAS:%=--extra %) -c requirements.lock -o requirements-dev.lock
	for simulator in $(OTHER_SIMULATORS); do $(COMPILE) tests/bench/other_simulators/$$simulator.in -o tests/bench/other_simulators/$$simulator.lock; done
	$(COMPILE) docs/website/site.in -o docs/website/site.lock
	$(BIN)/python -m docs.website.build --lock
	$(COMPILE) tests/mutants/mutmut.in -c requirements-dev.lock -o tests/mutants/mutmut.lock

clean: pure
	rm -rf $(VENV) .venv-other-simulators $(MUTANTS) $(SITE) $(WEB)/node_modules build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
