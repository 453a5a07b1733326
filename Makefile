# `make demo` and `make test`: each, alone, sets up everything it needs in .venv and then does its job.
# VENV=DIR puts the environment elsewhere; PYTHON=python3.12 picks the interpreter that a new one is made with.

PYTHON ?= python3
VENV ?= .venv
EXTRAS ?= render,train,orca,onnx,ray,docs,dev
CONSTRAINTS ?= constraints.txt
# A file a process: its tests use the same kernels, which two processes would compile twice.
TESTS ?= -n auto --maxprocesses 8 --dist loadfile
KILLS ?= 1000
HOSTILE ?= 1000
DECISIONS ?= 1000000
EPISODES ?= 100
NIGHT ?= results/night
DEMO ?= results/demo
BENCH ?= results/bench.jsonl
MINUTES ?= 4

RUN := $(VENV)/bin
STAMP := $(VENV)/.set-up
PIP := $(RUN)/python -m pip --disable-pip-version-check
# Byte code of all packages takes longer than all else of the installing: imports make what is used, if they may. -qq:
# pip warns for each package of an index that lacks it.
INSTALL := $(PIP) install -qq --constraint $(CONSTRAINTS) $(if $(PYTHONDONTWRITEBYTECODE),,--no-compile)
# What compiling kernels needs: it goes on while pip installs all else, torch above all.
COMPILING := setuptools numba gymnasium pettingzoo pyyaml safetensors platformdirs tyro rich filelock scipy

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help setup demo test night kills hostile long bounds docs gallery chart clients cuda gpu lint format bench clean missing

help: ## list the targets (the default)
	@awk -F ':.*## ' '/^[a-z]+:.*## /{printf "  make %-7s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: $(STAMP) ## set up .venv and compile all kernels
	@echo "Ready: $$($(RUN)/python --version) in $(VENV)"

demo: $(STAMP) ## compare the shipped policies with 16 robots: table, pictures and video in results/demo
	$(RUN)/warehouse demo --overwrite --out $(DEMO)

test: $(STAMP) ## run the tests
	$(RUN)/python -m pytest $(TESTS)

night: $(STAMP) ## run the long tests: kills, long episodes, browsers, clusters, wheels, plain Python
	$(RUN)/python -m pytest $(TESTS) -m nightly

kills: $(STAMP) ## kill commands KILLS times at random moments, resume them, and compare the results
	$(RUN)/python -m tests.kills --kills $(KILLS)

hostile: $(STAMP) ## feed all readers and constructors HOSTILE times as many hostile inputs as `test` does
	HOSTILE=$(HOSTILE) $(RUN)/python -m pytest $(TESTS) tests/test_hostile.py

long: $(STAMP) ## drive one world with all features for DECISIONS decisions, twice; resumes where it stopped
	$(RUN)/python -m tests.long --decisions $(DECISIONS) --keep $(NIGHT)/long

bounds: $(STAMP) ## drive EPISODES random episodes and hostile inputs with bounds checks in all kernels
	NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR=$(NIGHT)/bounds EPISODES=$(EPISODES) $(RUN)/python -m pytest \
	  tests/test_bounds.py tests/test_hostile.py -k "episode or environments or actions"

docs: $(STAMP) ## build the documentation in build/docs, with warnings as errors
	$(RUN)/python -m sphinx --quiet --fail-on-warning --keep-going --fresh-env docs build/docs
	@echo "wrote the documentation to build/docs; begin with build/docs/index.html"

gallery: $(STAMP) ## remake the animations of docs/gallery.md; needs Chromium
	$(RUN)/python docs/extensions/gallery.py

chart: $(STAMP) ## redraw docs/throughput.svg from docs/measured/throughput.jsonl
	$(RUN)/python docs/extensions/throughput.py

clients: ## try SuperSuit, TorchRL, BenchMARL, RLlib, Gymnasium and SB3 briefly in .venv-clients
	@$(MAKE) --no-print-directory test VENV=$(VENV)-clients EXTRAS=$(EXTRAS),clients \
	  CONSTRAINTS=constraints-clients.txt \
	  TESTS="tests/clients -m 'nightly or not nightly' --verbosity 1 --durations 0 --durations-min 1"

cuda: $(STAMP) ## compile the kernels for a GPU; on a machine with one, compare its bits with the CPU's
	@$(INSTALL) --no-build-isolation --editable ".[$(EXTRAS),cuda]"
	@if nvidia-smi -L 2>/dev/null; then $(RUN)/warehouse compile --cuda; fi
	$(RUN)/python -m pytest tests/simulation/device -n 4 --dist load -m "nightly or not nightly" -rsP --durations 0 \
	  --durations-min 1

gpu: cuda ## check, measure and train on a GPU, MINUTES minutes of it training, into results/gpu
	$(RUN)/warehouse bench --only cuda --seconds 2 --json results/gpu/bench.jsonl
	$(RUN)/warehouse train patient --device cuda --minutes $(MINUTES) --checkpoint-seconds 120 \
	  --out results/gpu --name policy
	$(RUN)/warehouse evaluate --policy results/gpu/policy patient careful --traffic none --layout paper46 --robots 32 64 \
	  --episodes 4 --out results/gpu

lint: $(STAMP) ## run ruff and strict mypy
	$(RUN)/ruff check
	$(RUN)/ruff format --check
	$(RUN)/mypy

format: $(STAMP) ## format the code and sort imports
	$(RUN)/ruff check --fix
	$(RUN)/ruff format

bench: $(STAMP) ## measure the speeds in docs/measured/speed.md
	$(RUN)/warehouse bench --json $(BENCH)

clean: ## remove the environment, caches and build products; keep results
	rm -rf .venv .venv-clients .ci-venv build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find warehouse_env agents train tests docs -name __pycache__ -type d -prune -exec rm -rf {} +

# Done again when a version changes or the environment's Python is gone. The CUDA build of torch, which pip takes where
# it sees no CPU build, works as well but is 3 GB larger. Setuptools is pinned, so no isolated build.
$(STAMP): pyproject.toml $(CONSTRAINTS) $(if $(wildcard $(RUN)/python),,missing)
	@$(RUN)/python -m pip --version >/dev/null 2>&1 || { \
	  command -v $(PYTHON) >/dev/null || { \
	    echo "$(PYTHON) was not found: install Python 3.11 or newer (Debian: apt install python3 python3-venv)," \
	         "or name it: make setup PYTHON=python3.12" >&2; exit 1; }; \
	  $(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	    echo "$(PYTHON) is $$($(PYTHON) --version 2>&1), but 3.11 or newer is needed:" \
	         "name a newer one, as in make setup PYTHON=python3.12" >&2; exit 1; }; \
	  $(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	    echo "$(PYTHON) cannot make virtual environments:" \
	         "install its venv module (Debian: apt install python3-venv) and run make again" >&2; exit 1; }; \
	  if [ -e $(VENV) ] && [ ! -f $(VENV)/pyvenv.cfg ]; then \
	    echo "$(VENV) exists and is no virtual environment: remove it, or name another folder with VENV=" >&2; \
	    exit 1; fi; \
	  echo "Making a virtual environment in $(VENV)"; \
	  rm -rf $(VENV) && $(PYTHON) -m venv $(VENV); }
	@echo "Installing the pinned packages, and compiling the kernels meanwhile (one to three minutes the first time)"
	@$(INSTALL) $(COMPILING)
	@$(INSTALL) --no-deps --no-build-isolation --editable .
	@$(RUN)/warehouse compile & compiling=$$!; \
	  $(INSTALL) --no-build-isolation --editable ".[$(EXTRAS)]" || \
	    { kill $$compiling; exit 1; }; \
	  wait $$compiling || echo "The kernels were not compiled: each will be when it is first called" >&2
	@$(RUN)/python -c 'import torch; print(f"torch {torch.__version__}" + (torch.version.cuda and \
	  ", with CUDA; for the smaller CPU build name its index in PIP_EXTRA_INDEX_URL" or ""))'
	@touch $@
