# `make` alone lists what there is.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
MISSION ?= mission/examples/lone_tree.toml
FLY ?=

.PHONY: help install fly test check bench docs dialect lock clean

help:
	@echo "make fly      set everything up, fly 8 vehicles to a tree     (MISSION=... FLY='-n 4 --seed 2')"
	@echo "make test     set everything up, run all tests"
	@echo "make check    lint, types, import contracts, generated files"
	@echo "make bench    the figures of docs/reference/figures.md, measured here and now"
	@echo "make install  only set up .venv"
	@echo "make docs     generate the reference from the code"
	@echo "make dialect  generate companion/mavlink/dialect.py from swarm.xml"
	@echo "make lock     resolve requirements.lock anew"

install: $(READY)

$(READY): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or newer is needed; $(PYTHON) is $$($(PYTHON) -V). Try: make PYTHON=python3.12 ..."; exit 1; }
	@$(PYTHON) -m venv $(VENV) || \
	  { rm -rf $(VENV); echo "python3 -m venv failed. On Debian and Ubuntu: sudo apt install python3-venv"; exit 1; }
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

fly: install
	$(BIN)/sim-bridge fly $(MISSION) $(FLY)

test: install
	$(BIN)/python -m pytest

check: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m companion.mavlink.generate --check
	$(BIN)/python docs/generate.py --check

bench: install
	$(BIN)/python -m tests.bench

docs: install
	$(BIN)/python docs/generate.py

dialect: install
	$(BIN)/python -m companion.mavlink.generate

lock: install
	$(BIN)/uv pip compile --universal --python-version 3.11 --generate-hashes --all-extras --quiet \
	  --no-emit-index-url --custom-compile-command 'make lock' -o requirements.lock pyproject.toml

clean:
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
