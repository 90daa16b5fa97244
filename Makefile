# Each target makes its own environment in .venv on a machine with Python 3.11 or newer, git and make.
PYTHON ?= python3
BIN := .venv/bin
SIM := .venv/.sim
DEV := .venv/.dev
DOCS := .venv/.docs
# Bytecode is not compiled in advance: most of the libraries' modules are never imported.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt
# Tests start many processes, each of which would else compile anew what it imports, where the environment forbids to keep it.
PYTEST := env -u PYTHONDONTWRITEBYTECODE $(BIN)/pytest
export OMP_NUM_THREADS = 1

.PHONY: demo docs test test-slow test-all faults planted fuzz soak px4-test docker-test image-test image-smoke bench table figures lint coverage words release clean

demo: $(SIM)  ## three agents over Zenoh and MAVLink find a source, live, two minutes; results/demo/
	$(BIN)/radron-sim live demo --seed 5 --out results/demo

# Three workers on two cores: many of these tests wait for other processes.
test: $(DEV)  ## the tests, without the slow ones
	$(PYTEST) -n 3 -m "not slow and not long"

test-slow: $(DEV)  ## the slow tests, of more than five seconds each, without the longest
	$(PYTEST) -n 2 -m "slow and not long"

test-all: $(DEV)  ## all tests
	$(PYTEST) -n 2

fuzz: $(DEV)  ## broken and random input for all readers, an hour on two cores at most; results/fuzz/
	$(BIN)/python -m tests.fuzz --out results/fuzz

soak: $(DEV)  ## an hour's mission and 20 short ones in lockstep, ten minutes live: nothing may be left over; results/soak/
	$(BIN)/python benchmarks/soak.py --lockstep 3600 --missions 20 --live 600 --out results/soak

# A real PX4: PX4_BIN=.../build/px4_sitl_default/bin/px4 (or PX4_IMAGE=px4io/px4-sitl:v1.17.0, by docker); PX4_TEST=emulated: emulated vehicles.
px4-test: $(SIM)  ## two missions, hold, a killed agent, lost GNSS, live on a real PX4; exit code 77 without one; results/px4-test/
	$(BIN)/radron-sim px4-test --out results/px4-test

faults: $(SIM)  ## 1,000 random missions with faults, resumable, two hours on two cores; exit code 1 if anything is violated; results/faults/
	$(BIN)/radron-sim faults --runs 1000 --out results/faults

planted: $(SIM)  ## which planted bugs the campaigns with faults find, at most 20 missions a bug, resumable; hours; results/planted/
	$(BIN)/python tests/faults/planted/run.py

docker-test: $(DEV)  ## the swarm in containers; needs a docker engine, or root to start one
	deploy/docker/test.sh

# Disks and kept states are 10 GB: only those of a run that failed stay, of the last one.
KEEP_FAILED := -o tmp_path_retention_policy=failed -o tmp_path_retention_count=1
# IMAGE=nuc.img: an image that is there already. Needs root or user namespaces, and the programs that its reason for skipping names.
image-test: $(DEV)  ## builds the onboard computer's image, and boots, updates and breaks it in qemu: hours; docs/nuc.md
	IMAGE_TEST=1 $(PYTEST) tests/image -rs -s --durations=0 $(KEEP_FAILED)

image-smoke: $(DEV)  ## of that, a build, a boot, an update and two power cuts
	IMAGE_TEST=1 $(PYTEST) tests/image -rs -s -x -m smoke --durations=0 $(KEEP_FAILED)

bench: $(DEV)  ## all benchmarks, one after another
	@set -e; for file in benchmarks/*.py; do echo "== $$file"; $(BIN)/python $$file; done

table: $(SIM)  ## comparison with the paper's table, 50 flights a column; results/table/
	$(BIN)/radron-sim table --runs 50 --out results/table

figures: $(SIM)  ## regenerates all figures of README and docs, about two hours on two cores; results/figures/
	$(BIN)/python docs/figures/results.py
	$(BIN)/python docs/figures/estimator.py --out docs
	$(BIN)/python benchmarks/stabilization.py --exact --figure docs/stabilization.png

docs: $(DOCS)  ## the documentation site, readable offline: build/site/index.html
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	@echo "Built build/site. To read it with its search: $(BIN)/python -m http.server --directory build/site"

lint: $(DEV)  ## style, types and import contracts
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	mkdir -p .venv/names/radron
	ln -sfn $(foreach name,agent deploy protocol sim station,$(CURDIR)/$(name)) .venv/names/radron/
	$(BIN)/mypy
	$(BIN)/lint-imports

coverage: $(DEV)  ## which lines and branches of the agent its tests run; a report, no threshold
	mkdir -p build
	$(BIN)/coverage run --branch --source=agent --data-file=build/coverage -m pytest -m "not slow and not long" tests/agent
	$(BIN)/coverage report --data-file=build/coverage --skip-covered

words: $(DEV)  ## how plain the prose of code and documents is, by path
	$(BIN)/python tests/lib/support/words.py

release: $(DEV)  ## sdist and wheel in dist/, checked as a user gets them; KEY=ID signs them, TAG=1 tags the commit
	.ci/release

clean:  ## removes the environment, the results and all caches
	rm -rf .venv build dist results *.egg-info .pytest_cache .hypothesis .mypy_cache .ruff_cache .import_linter_cache

$(SIM): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "radron needs Python 3.11 or newer, this is " + sys.version)'
	@echo "Setting up .venv (once, about a minute) ..."
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv
	@$(PIP) setuptools
	@$(PIP) --no-build-isolation --editable '.[sim,station]'
	@touch $@

$(DEV): $(SIM)
	@echo "Adding the tools for tests and checks ..."
	@$(PIP) --no-build-isolation --editable '.[sim,station,foxglove,tak,dev]'
	@touch $@

$(DOCS): $(SIM)
	@echo "Adding the tools for the documentation ..."
	@$(PIP) --no-build-isolation --editable '.[sim,station,docs]'
	@touch $@
