# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0

# make build   environment in .venv, both packages in it and compiled; nothing to source afterwards
# make demo    simulated muscle, on-line identification, a report
# make test    what takes no more than minutes, needs no browser
# make test-all  the whole suite
#              both in two processes (JOBS=1: in one)
#              ARGS='test/muscle -k twitch -x' goes to pytest instead, which then uses one process
# make lint    ruff, mypy, import contracts, headers    make format   what can be repaired by itself
# make docs    the site, in build/docs
# make bench   benchmarks
# make clean   remove what was built or written      make distclean   .venv too
#
# PYTHON=/path/to/python3.12 chooses the interpreter of .venv.

VENV := $(CURDIR)/.venv
BIN := $(VENV)/bin
STAMPS := $(VENV)/stamps

# An environment of its own: a sourced ROS must not show through.
unexport PYTHONPATH PYTHONHOME LD_LIBRARY_PATH CMAKE_PREFIX_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE
# With it, every process that a test starts would compile the package anew.
unexport PYTHONDONTWRITEBYTECODE
export PYTHON
export VIRTUAL_ENV := $(VENV)
export AMENT_PREFIX_PATH := $(VENV)
export PATH := $(BIN):$(PATH)

MSGS := $(shell find msg_defs -type f)
PACKAGE := package.xml setup.py setup.cfg resource/rpms_ros
COMPILED := $(shell grep -rl --include='*.py' njit rpms_ros)

.PHONY: build demo test test-all lint format docs bench clean distclean
.NOTPARALLEL:

INSTALLED := $(STAMPS)/msgs $(STAMPS)/package

build: $(INSTALLED) $(STAMPS)/compiled
	@:

# The environment does not depend on time: it is made when it is missing or half made.
ifneq ($(wildcard $(VENV)/.interrupted),)
.PHONY: $(STAMPS)/venv
endif

$(STAMPS)/venv:
	@tools/build venv
	@mkdir -p $(STAMPS) && touch $@

$(STAMPS)/lock: $(STAMPS)/venv requirements/rpms.lock
	@tools/build lock
	@touch $@

$(STAMPS)/msgs: $(STAMPS)/lock $(MSGS)
	@tools/build msgs
	@touch $@

$(STAMPS)/package: $(STAMPS)/lock $(PACKAGE)
	@tools/build package
	@touch $@

# Otherwise whoever identifies first would wait for it.
$(STAMPS)/compiled: $(INSTALLED) $(COMPILED)
	@tools/build compiled
	@touch $@

$(STAMPS)/docs: $(STAMPS)/package requirements/docs.lock
	@tools/build docs
	@touch $@

demo: build
	@$(BIN)/rpms demo

# A skipped test is a failed one, but for recordings that are not there: tools/skip_policy.py.
# Half of the time goes by waiting for processes: two at once suit any machine.
JOBS ?= 2
PARALLEL = $(if $(filter-out 1,$(JOBS)),--numprocesses=$(JOBS) --dist=worksteal)
PYTEST = ROS_PYTHON_CHECK_FIELDS=1 PYTHONPATH=tools $(BIN)/python -m pytest -p skip_policy
test: build
	@$(PYTEST) $(if $(ARGS),$(ARGS),-m 'not long' $(PARALLEL))

test-all: build
	@$(PYTEST) $(if $(ARGS),$(ARGS),$(PARALLEL))

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo
	tools/headers --check
	tools/sizes --check

format: $(INSTALLED)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	tools/headers

# Every warning ends it: a link that leads nowhere, a page outside the navigation, a notebook that fails.
docs: build $(STAMPS)/docs
	$(BIN)/python docs/figures.py
	$(BIN)/sphinx-build --fail-on-warning --keep-going --quiet -b html docs build/docs
	@echo build/docs/index.html

bench: build
	@$(BIN)/python bench/run.py $(ARGS)

clean:
	rm -rf build install log out *.egg-info .hypothesis docs/figures docs/reference/generated
	rm -f $(STAMPS)/compiled
	rm -rf .import_linter_cache .mypy_cache .pytest_cache .ruff_cache
	find . -path ./.venv -prune -o -type d -name __pycache__ -exec rm -rf {} +

distclean: clean
	rm -rf .venv
