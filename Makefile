# Needs Python >= 3.11 and make; everything else is installed into .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.synced
REPORT := $(VENV)/.report
APP := $(VENV)/.app
SYNC := VIRTUAL_ENV=$(CURDIR)/$(VENV) $(BIN)/uv sync --active --locked --inexact
INSTALL_UV := install --quiet --disable-pip-version-check "uv>=0.5"
# Node is in $(VENV) for the tests; else it is fetched for the time of the build
PAGES = $(if $(wildcard $(STAMP)),,$(BIN)/uv run --isolated --locked --only-group pages --python )$(BIN)/python tools/frontend.py
unexport PYTHONDONTWRITEBYTECODE # tests start many processes, which would compile every module again

.PHONY: setup demo app frontend test test-all lint docs study bench release clean

setup: $(STAMP)

# with the machine's pip where it has one: installing another takes longer than installing uv
$(BIN)/uv:
	$(PYTHON) -c 'import sys; sys.exit("truepose needs Python 3.11 or newer" if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv --without-pip $(VENV)
	if $(PYTHON) -m pip --version > /dev/null 2>&1; then $(PYTHON) -m pip --python $(BIN)/python $(INSTALL_UV); \
	else $(BIN)/python -m ensurepip > /dev/null && $(BIN)/python -m pip $(INSTALL_UV); fi

# what users need, without the tools of the tests; Python and numba compile what is used when it is used
$(REPORT) $(APP): $(BIN)/uv pyproject.toml uv.lock
	$(SYNC) --no-default-groups --extra $(patsubst .%,%,$(@F))
	touch $@

$(STAMP): $(BIN)/uv pyproject.toml uv.lock
	$(SYNC) --compile-bytecode
	$(BIN)/truepose warm-up
	$(BIN)/python tools/frontend.py status
	touch $(STAMP) $(REPORT) $(APP)

demo: $(REPORT)
	$(BIN)/truepose demo build/demo --force

# npm and the virtual cell at the same time
app: $(APP)
	$(MAKE) --no-print-directory -j 2 frontend build/.virtual-cell
	$(BIN)/truepose app build/app $(APPOPTS)

build/.virtual-cell: | $(APP)
	$(BIN)/truepose demo build/app/virtual-cell --predictor kinematic-kriging --force > /dev/null
	touch $@

frontend: $(BIN)/uv
	$(PAGES) build

test: $(STAMP) frontend
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
	$(SYNC) --group docs
	$(BIN)/sphinx-build -W --keep-going -j auto -b html $(SPHINXOPTS) docs docs/_build/html

study: setup
	$(BIN)/truepose study docs/validation/paper --force
	$(BIN)/truepose study docs/validation/hard --preset hard --force

bench: setup
	$(SYNC) --group bench
	$(BIN)/python -m benchmarks

# make release VERSION=0.3.0, to see what would stop it first: RELEASEOPTS=--dry-run
release: frontend
	$(BIN)/python tools/release.py $(RELEASEOPTS) $(VERSION)

clean:
	rm -rf $(VENV) build src/truepose/web/static frontend/node_modules
