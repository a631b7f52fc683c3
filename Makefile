# Wingbeat on a fresh machine: Python 3.11 or newer, and make.
#
#   make fly       fly, record, identify          (make fly ARGS="--vehicle arizona_100cm --seed 7")
#   make test      every check but the long studies
#   make docs      the documentation site in build/site
#   make bench     how fast it is
#   make validate  the long studies
#   make clean     remove the environment and the caches; recordings stay
#
# PYTHON=python3.12 chooses another interpreter for the environment.

PYTHON ?= python3
ARGS ?=
VENV := .venv
BIN := $(VENV)/bin
# What is never imported need not be compiled: half of what an installation takes.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-input --no-compile
# Ground stations of others. The tests run MAVProxy without its windows, which would take 0.9 GB of libraries: 140 MB and
# 6 s without their dependencies, 1.1 GB and 40 s with them; the rest of what they import is ours too.
EXTRA = $(BIN)/python -c "import sys, tomllib; \
    print(*tomllib.load(open('pyproject.toml', 'rb'))['project']['optional-dependencies'][sys.argv[1]])"
PYTEST := $(BIN)/python -m pytest -q -m "not bench and not validate"
# Modules are compiled once, at their first import, not in every process.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: docs docs/parameters.md help fly test lint kernels collected imports bench validate clean

help:
	@sed -n 's/^#   //p' Makefile

fly: $(VENV)/.installed
	@$(BIN)/wingbeat fly $(ARGS)

# What every worker would do for itself is done once before they start: one core compiles kernels and collects the tests
# while the other installs the checks and makes the longest of them. Three workers on two cores: tests of links wait over
# a minute in all for an answer or for its absence, in which another can work.
test: $(VENV)/.installed
	@$(MAKE) --no-print-directory -j 2 lint imports
	$(PYTEST) -n 3 --dist loadfile --no-loadscope-reorder

docs: $(VENV)/.installed-dev
	$(BIN)/python docs/site/build.py build/site

docs/parameters.md: $(VENV)/.installed
	@$(BIN)/python docs/write_parameters.py $@

kernels: $(VENV)/.installed
	@$(BIN)/wingbeat trim robo_raven_ii_d > /dev/null
	@for table in short_period transport; do \
	    $(BIN)/wingbeat identify docs/examples/$$table.csv --map docs/examples/$$table.toml > /dev/null || exit; done

# The tests rewritten for their assertions (what is wrong in them pytest tells when they are run), and the kernels of a
# batch of vehicles. After the physics: the other core still looks through the sources.
collected: kernels $(VENV)/.installed-dev
	@$(PYTEST) --collect-only > /dev/null 2>&1 || true
	@$(BIN)/python -c "import gymnasium; e = gymnasium.make_vec('wingbeat.gym:wingbeat/Flapping-v0', num_envs=2); \
	    e.reset(seed=1); e.step(e.action_space.sample())" > /dev/null 2>&1 || true

imports: collected
	$(BIN)/lint-imports

lint: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(VENV)/.installed-bench
	$(BIN)/python -m pytest -q -s -m bench --bench-table docs/validation/benchmarks.md tests

validate: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -q -s -m "validate or hypothesis" --hypothesis-profile=thorough tests

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || \
	    { echo 'wingbeat needs Python 3.11 or newer as $(PYTHON); choose one with: make PYTHON=python3.12' >&2; exit 2; }
	@echo 'creating $(VENV)'
	@$(PYTHON) -m venv $(VENV) || \
	    { rm -rf $(VENV); echo 'cannot create $(VENV): is the venv module of $(PYTHON) installed (python3-venv)?' >&2; exit 2; }

# Installed once for each state of pyproject.toml.
$(VENV)/.installed: pyproject.toml | $(BIN)/python
	@echo 'installing wingbeat (once)'
	@$(PIP) -e .
	@touch $@

# The developer's set besides: beside a running wingbeat, so that nothing of the flyer's is installed again.
$(VENV)/.installed-dev: $(VENV)/.installed
	@echo 'installing its checks (once)'
	@$(PIP) $$($(EXTRA) dev)
	@$(PIP) --no-deps $$($(EXTRA) clients) || echo 'MAVSDK and MAVProxy cannot be had here: their tests are skipped' >&2
	@touch $@

# Packages that benchmarks are measured beside; without one of them its rows are left out.
$(VENV)/.installed-bench: $(VENV)/.installed-dev
	@echo 'installing the peers of the benchmarks (once)'
	@$(PIP) $$($(EXTRA) bench) || echo 'not all peers can be had here: their benchmarks are skipped' >&2
	@touch $@

clean:
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis .benchmarks
	find wingbeat avionics sim_bridge logs groundstation tests -name __pycache__ -type d -prune -exec rm -rf {} +
