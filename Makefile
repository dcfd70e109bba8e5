# Everything a person types: `make paint` for a first painting, `make test` for the whole test suite.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PHOTO ?= examples/photographs/coffee.jpg

.PHONY: paint test quick lint benchmarks install browser clean

install: $(VENV)/installed

$(VENV)/installed: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or newer is needed; say e.g. make PYTHON=python3.12 $(MAKECMDGOALS)" if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $@

paint: install
	@$(BIN)/frida-painter paint $(PHOTO)

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# The studio is tested in a real browser where there is one, or where it can be installed; elsewhere those tests skip.
browser:
	@command -v chromium >/dev/null || { [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null \
		&& apt-get -qq update && apt-get -qq install -y --no-install-recommends chromium; } || true

test: lint browser
	$(BIN)/pytest -n 2 --dist worksteal

quick: install
	$(BIN)/pytest -n 2 --dist worksteal -m "not slow"

benchmarks: install
	$(BIN)/python benchmarks/report.py

clean:
	rm -rf $(VENV) build *.egg-info
