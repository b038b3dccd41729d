# rotorlab: `make run` and `make test` set up a fresh machine by themselves.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
export OPENBLAS_NUM_THREADS := 1
export PIP_DISABLE_PIP_VERSION_CHECK := 1

FRONTEND := $(shell find web/frontend -name node_modules -prune -o -type f -print 2>/dev/null)
KERNELS := $(shell grep -rl --include='*.py' 'models.kernel import' models estimators controllers sitl gcs 2>/dev/null) models/kernel.py

.PHONY: help setup run test lint bench lock clean browser
help:
	@echo "make setup   environment, packages, browser bundle, compiled kernels (idempotent)"
	@echo "make run     set up, then a simulated quadrotor with station and dashboard; prints the link"
	@echo "make test    set up, then lint, types and every test, those in a real browser too"
	@echo "make bench   every figure beside its peer"

setup: $(VENV)/.packages $(VENV)/.bundle $(VENV)/.kernels

$(VENV)/.packages: requirements.lock pyproject.toml
	@echo "[1/3] Python packages into $(VENV)"
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "rotorlab needs Python 3.11 or newer: make PYTHON=python3.12 setup")'
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --progress-bar on -q -r requirements.lock
	@$(BIN)/python -m pip install -q --no-deps --no-build-isolation -e .
	@touch $@

$(VENV)/.bundle: $(VENV)/.packages hatch_build.py $(FRONTEND)
	@echo "[2/3] Browser bundle"
	@$(BIN)/python hatch_build.py
	@touch $@

$(VENV)/.kernels: $(VENV)/.packages $(KERNELS)
	@echo "[3/3] Kernels"
	@$(BIN)/python -m gcs.compile_ahead
	@touch $@

run: setup
	@$(BIN)/gcs up --sim quadrotor $(ARGS)

lint: setup
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy

test: setup lint browser
	@$(BIN)/pytest $(ARGS)

bench: setup
	@for file in benchmarks/*.py; do echo "== $$file"; $(BIN)/python $$file || exit 1; done

# The dashboard is tested in the system's Chromium.
browser:
	@command -v chromium >/dev/null || command -v chromium-browser >/dev/null || command -v google-chrome >/dev/null || \
	if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	  echo "Installing Chromium for the browser tests"; apt-get update -qq && apt-get install -y -qq chromium >/dev/null; \
	else echo "The browser tests need Chromium. Run: sudo apt-get install -y chromium"; exit 1; fi

# Refresh the lock file; it names no registry.
lock:
	@$(BIN)/python -m pip install -q uv
	@$(BIN)/uv pip compile -q --universal --python-version 3.11 --extra dev --generate-hashes --no-header \
	  --no-emit-index-url --no-emit-find-links -o requirements.lock pyproject.toml build-requirements.in

clean:
	rm -rf $(VENV) web/static web/frontend/node_modules
	find . -name __pycache__ -prune -exec rm -rf {} +
