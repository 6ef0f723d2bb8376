# The verbs of this project, for people and for CI. `make help` lists them.

# The locked versions were resolved on Python 3.11; any later one should do: make PYTHON=python3.12 setup
PYTHON ?= $(shell command -v python3.11 || command -v python3)
# Further arguments, for example: make setup PIP_ARGS="--extra-index-url URL" · make test PYTEST_ARGS="-m 'not slow'"
PIP_ARGS ?=
PYTEST_ARGS ?=
REPRODUCE_ARGS ?=
# BENCH_ARGS=--quick: only see that all of them run
BENCH_ARGS ?=
JOBS ?= 2

VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
PACKAGES := object_sets randomization reproduce tactile_kit
CODE := $(wildcard $(PACKAGES) tests benchmarks)

.DEFAULT_GOAL := help
.PHONY: help setup reproduce test test-cluster coverage lint format bench docs clean

help:  ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-12s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: $(INSTALLED)  ## install everything into .venv, in the versions of constraints.txt
	@:

# The stamp is written last, so a broken installation is tried again.
$(INSTALLED): setup.cfg pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
		|| { echo "$(PYTHON) is too old or absent: Python >= 3.11 is needed (make PYTHON=/path/to/python setup)"; exit 1; }
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv $(VENV) \
		|| { echo "no virtual environment could be made; on Debian: apt-get install python3-venv"; exit 1; }
	$(BIN)/python -m pip install --quiet --constraint constraints.txt $(PIP_ARGS) --editable '.[dev,transfer]'
	@for module in pybullet torch numba manifold3d rtree coacd matplotlib; do \
		$(BIN)/python -c "import $$module" 2>$(VENV)/.import-error || { tail -n 1 $(VENV)/.import-error; \
		echo "$$module does not load: is a system library missing? On Debian: apt-get install libgomp1 libgl1 libstdc++6"; \
		exit 1; }; done
	@touch $@

reproduce: setup  ## every table, figure and the report, from the shipped agents
	$(BIN)/reproduce run --scale small --from pretrained $(REPRODUCE_ARGS)

# One thread a process: JOBS processes share the cores, and results don't depend on how many there are.
test: setup  ## all tests
	OMP_NUM_THREADS=1 MPLBACKEND=Agg $(BIN)/python -m pytest -n $(JOBS) $(PYTEST_ARGS)

# Debian's Slurm: apt-get install --no-install-recommends slurm-wlm munge. No systemd, nothing of the system's is touched.
test-cluster: setup  ## the workflow on a Slurm of this machine: jobs, a node and the controller are killed
	@$(BIN)/python -c "import snakemake_executor_plugin_cluster_generic" 2>/dev/null \
		|| $(BIN)/python -m pip install --quiet --constraint constraints.txt $(PIP_ARGS) --editable '.[slurm]'
	OMP_NUM_THREADS=1 MPLBACKEND=Agg $(BIN)/python -m pytest -n 0 -m cluster $(PYTEST_ARGS) tests/clusters

# Each package for itself: a well tested one must not make up for another.
coverage: setup  ## lines that the tests run, at least 90 % of each package; a quarter of an hour on two cores
	@mkdir -p .cache
	OMP_NUM_THREADS=1 MPLBACKEND=Agg $(BIN)/python -m pytest -n $(JOBS) -o timeout=1200 \
		--cov --cov-report= --cov-fail-under=0 $(PYTEST_ARGS)
	@for package in $(PACKAGES); do echo; echo "$$package"; \
		$(BIN)/coverage report --include "$$package/*" --skip-covered || failed=1; done; exit $${failed:-0}

lint: setup  ## style and types
	$(BIN)/ruff check $(CODE)
	$(BIN)/ruff format --check $(CODE)
	$(BIN)/mypy

format: setup  ## mend the style
	$(BIN)/ruff check --fix $(CODE)
	$(BIN)/ruff format $(CODE)

bench: setup  ## measure speed and physics, some twenty minutes of an idle machine; the tables of docs/speed.md and docs/physics.md
	@for script in benchmarks/bench_*.py; do \
		echo "$$script"; OMP_NUM_THREADS=1 $(BIN)/python "$$script" $(BENCH_ARGS) || exit 1; done
	$(BIN)/python benchmarks/render.py

docs: setup  ## the pages that are made from data and code, and from all of them the site: site/index.html, offline
	$(BIN)/python -m randomization.table docs/randomization.md
	$(BIN)/python -m reproduce.readme README.md results
	$(BIN)/python -m reproduce.pages docs
	@$(BIN)/python -c "import mkdocs_autorefs, material" 2>/dev/null \
		|| $(BIN)/python -m pip install --quiet --constraint constraints.txt $(PIP_ARGS) --editable '.[docs]'
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet

clean:  ## remove caches and what builds leave behind (not .venv, not results)
	rm -rf site .cache .pytest_cache .hypothesis .snakemake .coverage build dist *.egg-info
	find . -path ./$(VENV) -prune -o -name __pycache__ -type d -print0 | xargs -0 rm -rf
