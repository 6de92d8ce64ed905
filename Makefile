# Needs Python 3.12 with pip (or uv), make and git; everything else is set up below this folder, once.
.DEFAULT_GOAL := help
.PHONY: help demo tuner test lint kernels soak pins clean

export UV_PYTHON_DOWNLOADS := never
export PIP_ROOT_USER_ACTION := ignore
export PIP_DISABLE_PIP_VERSION_CHECK := 1

# The pins hold ROS 2 Jazzy for x86_64: a ROS installation sourced in this shell must not mix with it.
# Elsewhere a sourced installation is what the demo and the tests run on.
ifeq ($(shell uname -sm),Linux x86_64)
unexport PYTHONPATH AMENT_PREFIX_PATH COLCON_PREFIX_PATH CMAKE_PREFIX_PATH ROS_DISTRO ROS_VERSION RMW_IMPLEMENTATION
endif
# Set by the ROS wheels of another environment, where make runs below one.
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE VIRTUAL_ENV
# The tests start hundreds of processes, each of which would compile all modules anew.
unexport PYTHONDONTWRITEBYTECODE

UV_ON_PATH := $(shell command -v uv 2>/dev/null)
UV := $(or $(UV_ON_PATH),.tools/bin/uv)
UV_VERSION := 0.13.9
PYTHON := .venv/bin/python
READY := .venv/.ready

# Shell: sets `python` to the interpreter to use, or ends with one line that says what is missing.
FIND_PYTHON = python=; \
	for name in python3.12 python3 python; do \
	  found=$$("$$name" -c 'import sys; print(sys.executable if sys.version_info[:2] == (3, 12) else "")' 2>/dev/null); \
	  if [ -n "$$found" ]; then python=$$found; break; fi; \
	done; \
	if [ -z "$$python" ]; then \
	  echo "make: no Python 3.12 found (tried python3.12, python3, python): install python3.12 and put it on PATH" >&2; exit 1; \
	fi

help:  ## this list
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "  make %-6s %s\n", $$1, $$2 }' Makefile

demo: $(READY)  ## the node at work on a real stereo pair; results in demo_output/
	@"$(PYTHON)" -m svdm_ros.demo $(ARGS)

tuner: $(READY)  ## sliders in the browser, on the demo pair (ARGS='BAG' or ARGS='LEFT RIGHT' for yours)
	@"$(PYTHON)" -m svdm_ros.tuner $(or $(ARGS),--demo)

# Three processes on two cores, as half of the time of a test of the node is waiting; a file of tests at a time in each.
# -n 0 in ARGS for one process, whose output -s shows.
test: $(READY)  ## lint, then all tests (ARGS='-k name' for some of them)
	@"$(MAKE)" --no-print-directory --jobs=2 --output-sync=target lint kernels
	@"$(PYTHON)" -m pytest -n 3 --dist loadfile $(ARGS)

# What most tests need, compiled once: processes of tests would do it side by side.
kernels: $(READY)
	@"$(PYTHON)" -m svdm_core warmup

lint: $(READY)  ## ruff, and mypy --strict
	@"$(PYTHON)" -m ruff check .
	@"$(PYTHON)" -m mypy

soak: kernels  ## the node among hostile messages and requests (ARGS='--minutes 60 --seed 1'); not part of make test
	@"$(PYTHON)" -m svdm_ros.soak $(ARGS)

pins: $(READY)  ## renew requirements-dev.txt and requirements-uv.txt: newest versions, with hashes
	@"$(UV)" pip compile --quiet --upgrade --universal --generate-hashes --no-header --no-annotate --python-version 3.12 \
	    requirements-dev.in --output-file requirements-dev.txt
	@echo 'uv==$(UV_VERSION)' | "$(UV)" pip compile --quiet --generate-hashes --no-header --no-annotate \
	    --python-version 3.12 - --output-file requirements-uv.txt

clean:  ## remove what make set up and what the tools left
	rm -rf .venv .tools build install log demo_output *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# From scratch each time: a second sync into the same .venv leaves the ROS wheels without their Python modules.
# Editable, so that the console scripts exist; the sources are those of this folder.
$(READY): requirements-dev.txt setup.py setup.cfg package.xml $(if $(UV_ON_PATH),,.tools/bin/uv)
	@$(FIND_PYTHON); \
	set -e; \
	echo "make: setting up .venv with $$("$$python" --version) and the pinned packages: 1 GB, once, a minute or more"; \
	"$(UV)" venv --quiet --clear --python "$$python" .venv; \
	"$(UV)" pip sync --quiet --require-hashes --python "$(PYTHON)" requirements-dev.txt; \
	"$(UV)" pip install --quiet --no-deps --no-build-isolation --python "$(PYTHON)" --editable .; \
	touch "$@"

.tools/bin/uv: requirements-uv.txt
	@$(FIND_PYTHON); \
	if ! "$$python" -m pip --version >/dev/null 2>&1; then \
	  echo "make: $$python has no pip: install python3-pip (or uv)" >&2; exit 1; \
	fi; \
	echo "make: fetching uv $(UV_VERSION) into .tools"; \
	"$$python" -m pip install --quiet --upgrade --target .tools --only-binary :all: --require-hashes -r requirements-uv.txt && touch "$@"
