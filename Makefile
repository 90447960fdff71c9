# make run    set up and fly the default mission
# make test   set up and run the tests
# make check  lint, types, and the unit tests near what changed since main
# make setup  only set up: .venv with locked dependencies, C++ kernels built
# make wheel  build the wheel into dist/ and try it in a clean environment
# make docs   build the book into build/docs; a broken link is an error
PYTHON ?= python3
ARGS ?=
HIL := .venv/bin/hil
PY := .venv/bin/python

.PHONY: help run test check test-all wheel lint format setup docs art lock clean

help:
	@sed -n '1,6s/^# //p' Makefile

setup:
	@$(PYTHON) tools/setup_env.py

run: setup
	$(HIL) run $(ARGS)

# Tests share no state but the machine; each worker keeps the fixtures of its own files. Half of a worker's time is
# waiting for other processes, so five workers are right for two cores.
PARALLEL := -n 5 --dist worksteal

# Each of the hundreds of processes that the tests start would otherwise compile every module that it imports.
unexport PYTHONDONTWRITEBYTECODE

test: setup
	$(PY) -m pytest -m "not slow" $(PARALLEL) $(ARGS)

# Lint before a build of C++, which takes minutes.
check:
	@[ -x .venv/bin/ruff ] || $(PYTHON) tools/setup_env.py
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	@$(PYTHON) tools/setup_env.py
	$(PY) tools/check.py

test-all: setup
	$(PY) -m pytest $(PARALLEL) $(ARGS)

wheel: setup
	$(PY) tools/check_wheel.py

# What browsers run: JavaScript and its pages.
PAGES := hil/apps hil/run/report

lint: setup
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/mypy
	.venv/bin/oxlint $(PAGES)
	.venv/bin/oxfmt --check $(PAGES)

format: setup
	.venv/bin/ruff check --fix .
	.venv/bin/ruff format .
	.venv/bin/oxfmt $(PAGES)

# The variable silences mkdocs-material's notice about its successor.
docs: setup
	$(PY) -m pip install -q --disable-pip-version-check --constraint requirements.lock "mkdocs-material>=9.5"
	NO_MKDOCS_2_WARNING=1 $(PY) -m mkdocs build --strict

# Models and textures of sim/scene/assets, all of them again.
art: setup
	$(PY) -m tools.art

# Needs `uv` on the PATH: resolves for every platform and Python >= 3.11 at once.
lock:
	uv pip compile --universal --python-version 3.11 --no-emit-index-url --no-emit-find-links \
	  --custom-compile-command "make lock" tools/requirements.in -o requirements.lock

clean:
	rm -rf build .venv .pytest_cache .mypy_cache .ruff_cache
