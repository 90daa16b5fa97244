# Each target makes its own environment in .venv on a machine with Python 3.11 or newer, git and make.
PYTHON ?= python3
BIN := .venv/bin
SIM := .venv/.sim
DEV := .venv/.dev
# Not compiled ahead: most of what comes with the libraries is never imported.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt
export OMP_NUM_THREADS = 1

.PHONY: demo test docker-test bench table lint clean

demo: $(SIM)  ## three agents over Zenoh and MAVLink find a source, live, two minutes; results/demo/
	$(BIN)/radron-sim live demo --seed 1 --out results/demo

test: $(DEV)  ## all tests
	$(BIN)/pytest -n 2

docker-test: $(DEV)  ## the swarm in containers; needs a docker engine, or root to start one
	deploy/docker/test.sh

bench: $(SIM)  ## all measurements of speed, one after another
	@set -e; for file in benchmarks/*.py; do echo "== $$file"; $(BIN)/python $$file; done

table: $(SIM)  ## the paper's table beside ours, 50 flights a column; results/table/
	$(BIN)/radron-sim table --runs 50 --out results/table

lint: $(DEV)  ## style, types and who may import whom
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

clean:  ## the environment, the results and all caches
	rm -rf .venv build dist results *.egg-info .pytest_cache .hypothesis .mypy_cache .ruff_cache .import_linter_cache

$(SIM): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "radron needs Python 3.11 or newer, this is " + sys.version)'
	@echo "Setting up .venv (once, about a minute) ..."
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv
	@$(PIP) setuptools
	@$(PIP) --no-build-isolation --editable '.[sim]'
	@touch $@

$(DEV): $(SIM)
	@echo "Adding the tools for tests and checks ..."
	@$(PIP) --no-build-isolation --editable '.[sim,dev]'
	@touch $@
