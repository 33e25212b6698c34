# `make demo` and `make test` each work alone on a fresh machine with Python >= 3.11.
PYTHON ?= python3
BIN := .venv/bin

# Python keeps what it compiles: without it each process that a test starts would compile it anew.
export PYTHONDONTWRITEBYTECODE =

.PHONY: demo test lint docs benchmark format viewer clean

demo: .venv/installed
	$(BIN)/jaxfsi study --demo --quick --out results

test: .venv/installed-test lint
	$(BIN)/python -m pytest -m "not slow and not gpu" -n 2 --dist loadfile --max-worker-restart 0 --durations 15

# The third line finds undefined names, where no shape strings of jaxtyping look like them.
lint: .venv/installed-test
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/ruff check --isolated --target-version py311 --select F821 study benchmarks
	$(BIN)/lint-imports --no-cache
	$(BIN)/basedpyright

# Runs every tutorial and example; a warning, dead links among them, ends it. No network is used.
docs: .venv/installed-test
	$(BIN)/python -m sphinx -n -W --keep-going -b html docs build/docs

benchmark: .venv/installed-benchmark
	$(BIN)/python -m benchmarks --out results/benchmarks

format: .venv/installed-test
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

# Only who changes the interactive page needs node: its bundle is kept.
viewer:
	cd study/report/viewer && npm ci --no-audit --no-fund && npm run build

.venv/bin/python:
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python >= 3.11 is needed; set PYTHON=/path/to/python3.11")'
	$(PYTHON) -m venv .venv

.venv/installed: .venv/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --editable .
	touch $@

.venv/installed-test: .venv/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --editable '.[test,docs]'
	touch $@ .venv/installed

.venv/installed-benchmark: .venv/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --editable '.[benchmark]'
	touch $@ .venv/installed

clean:
	rm -rf .venv results build docs/auto
