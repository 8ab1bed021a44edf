# `make demo` and `make test` set up what they need; the second time they start at once.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO_FLAGS ?=
PIP_FLAGS ?=
TEST_PROCESSES ?= 2

# In this order: all others begin with the encoder of the first, or those that end in 2 with pillars2, vic_integrated with
# ff_tracking, cooptrack and univ2x with queries.
WEIGHTS := pillars early fcooper attfuse where2comm pyramid gsaf gsaf64 attfuse64 where2comm64 disconet v2vnet cobevt v2x_vit v2x_vit64 lift_splat points_and_pictures point_identity picture_identity ff_tracking vic_integrated queries cooptrack univ2x early2 attfuse2 gsaf2 where2comm2 queries2 cooptrack2 dmstrack_seen dmstrack
TRAIN_FLAGS ?=

# Python keeps what it compiles, whatever the shell says: each of the many processes would compile all anew.
export PYTHONDONTWRITEBYTECODE :=

# Unit tests of the rooms that have compiled kernels.
KERNEL_ROOMS := $(addprefix tests/unit/,bench/detect comms data detection envs fusion geometry metrics nn/detector \
	sensors tracking types world)

# Interpreters besides the usual one, and what is tested with them.
PYTHONS ?= python3.12 python3.13
PYTHON_TOOLS := filterpy hypothesis motmetrics psutil pytest shapely
PYTHON_ROOMS := $(addprefix tests/unit/,config geometry metrics support tracking types wire)

.PHONY: demo test lint types check check-long check-pythons docs bench weights clean

demo: $(VENV)/.user
	$(BIN)/coopsim demo $(DEMO_FLAGS)

# Processes begin with different slow files, so few kernels are compiled twice; who is done takes from the others' rest.
# Each has one thread: take as many as there are cores. A test that computes for too long fails.
test: export OMP_NUM_THREADS := 1
test: $(VENV)/.dev
	$(BIN)/python -m pytest --numprocesses $(TEST_PROCESSES) --dist worksteal --hold-times

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports

types: $(VENV)/.dev
	$(BIN)/mypy

check: lint types test

# What only long runs show, with workers that start as users' do; then laws with more examples, and rooms with kernels,
# compiled anew with indices checked.
check-long: export OMP_NUM_THREADS := 1
check-long: $(VENV)/.dev
	$(BIN)/python -m pytest -m long --start-anew --numprocesses $(TEST_PROCESSES) --dist worksteal
	NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR=$(CURDIR)/build/checked_kernels $(BIN)/python -m pytest $(KERNEL_ROOMS) tests/property \
		--hypothesis-profile thorough --numprocesses $(TEST_PROCESSES) --dist worksteal

# A short selection with other Pythons, without torch; those that are not installed are named and left out.
check-pythons:
	set -e; for python in $(PYTHONS); do \
		$$python -c pass 2>/dev/null || { echo "$$python is not here"; continue; }; \
		env=build/pythons/$$($$python -c 'import sys; print(sys.version.split()[0])'); echo "$$env"; \
		test -x $$env/bin/python || $$python -m venv $$env; \
		$$env/bin/python -m pip install --quiet --constraint constraints.txt --editable '.[camera]' $(PYTHON_TOOLS); \
		$$env/bin/coopsim demo --frames 3 --report $$env/demo.html; \
		OMP_NUM_THREADS=1 $$env/bin/python -m pytest -q $(PYTHON_ROOMS); \
	done

# The site, from docs/ into build/site/index.html, and the leaderboard of the scores in leaderboard/; the switch silences what plugins say of mkdocs' future.
docs: $(VENV)/.dev
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict
	$(BIN)/coopsim entry page leaderboard/* --runs leaderboard_runs --out build/site/leaderboard

bench: $(VENV)/.dev
	$(BIN)/python -u -m pytest tests/benchmarks --override-ini=addopts= -s -q

# Train all weights that ship anew, one after the other; what was interrupted goes on. The last reads COOPSIM_DATA.
weights: $(VENV)/.dev
	set -e; for name in $(WEIGHTS); do \
		$(BIN)/coopsim train $$name --out build/weights/$$name $(TRAIN_FLAGS); \
		cp build/weights/$$name/$$name.safetensors coopsim/weights/; \
		cp build/weights/$$name/card.json coopsim/weights/$$name.json; \
	done

clean:
	rm -rf $(VENV) build dist *.egg-info .import_linter_cache .pytest_cache .mypy_cache .ruff_cache

# The stamps depend on what decides the environment's content, so a changed pin installs again.
# What users need comes with the rest, in one go, where tests are to run.
$(VENV)/.user: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet $(PIP_FLAGS) --constraint constraints.txt --editable '.[camera]'
	touch $@

$(VENV)/.dev: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet $(PIP_FLAGS) --constraint constraints.txt --editable '.[camera,dev]'
	touch $(VENV)/.user $@
