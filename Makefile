# Needs Python >= 3.11 and make; everything else is installed into .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.synced
RUNTIME := $(VENV)/.runtime
unexport PYTHONDONTWRITEBYTECODE # tests start many processes, which would compile every module again

.PHONY: setup demo app frontend test test-all lint docs study bench release clean

setup: $(STAMP)

$(BIN)/uv:
	$(PYTHON) -c 'import sys; sys.exit("truepose needs Python 3.11 or newer" if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check "uv>=0.5"

# what users need; the tests' tools are in $(STAMP)
$(RUNTIME): $(BIN)/uv pyproject.toml uv.lock
	VIRTUAL_ENV=$(CURDIR)/$(VENV) $(BIN)/uv sync --active --locked --inexact --no-default-groups --compile-bytecode
	$(BIN)/truepose warm-up
	touch $(RUNTIME)

$(STAMP): $(BIN)/uv pyproject.toml uv.lock
	VIRTUAL_ENV=$(CURDIR)/$(VENV) $(BIN)/uv sync --active --locked --inexact --compile-bytecode
	$(BIN)/truepose warm-up
	$(BIN)/python tools/frontend.py status
	touch $(STAMP) $(RUNTIME)

demo: $(RUNTIME)
	$(BIN)/truepose demo build/demo --force

app: frontend
	$(BIN)/truepose app build/app --demo

frontend: $(STAMP)
	$(BIN)/python tools/frontend.py build

test: frontend
	$(BIN)/python tools/frontend.py test
	$(BIN)/pytest -n auto --dist worksteal $(TESTS)

# the second tier, too: the same behaviours repeated (see tests/tiers.py)
test-all: export TRUEPOSE_TESTS := all
test-all: test

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python tools/frontend.py check

docs: setup
	VIRTUAL_ENV=$(CURDIR)/$(VENV) $(BIN)/uv sync --active --locked --inexact --group docs
	$(BIN)/sphinx-build -W --keep-going -j auto -b html $(SPHINXOPTS) docs docs/_build/html

study: setup
	$(BIN)/truepose study docs/validation/paper --force
	$(BIN)/truepose study docs/validation/hard --preset hard --force

bench: setup
	VIRTUAL_ENV=$(CURDIR)/$(VENV) $(BIN)/uv sync --active --locked --inexact --group bench
	$(BIN)/python -m benchmarks

# make release VERSION=0.3.0, to see what would stop it first: RELEASEOPTS=--dry-run
release: frontend
	$(BIN)/python tools/release.py $(RELEASEOPTS) $(VERSION)

clean:
	rm -rf $(VENV) build src/truepose/web/static frontend/node_modules
