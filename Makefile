# Everything a person types: `make paint` for a first painting, `make test` for the whole test suite.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PHOTO ?= examples/photographs/coffee.jpg
# Each of these files in .venv says that one set of packages is installed: what painting needs, and more beside it.
PINS := pyproject.toml constraints.txt
# HASHES=no also takes files that are not those of constraints.txt, such as builds of your own index.
ADD := $(BIN)/python tools/install.py $(if $(filter no,$(HASHES)),--without-hashes)

# A painting that uses all that later ones use. If it fails, people still get what is installed, and its error.
FIRST := $(BIN)/frida-painter paint examples/photographs/coffee.jpg --brushes broad,medium,fine \
	--strokes 12 --colors 3 --render-height 64 --effort 0.05 --replans 1

PROGRAM ?= storm stop attack hostile_commands kills claims moved_canvas every franka so101

.PHONY: pins paint studio test quick nightly stress views lint docs size benchmarks benchmarks-gpu install browser downloads clean reference

install: $(VENV)/dev

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or newer is needed; say e.g. make PYTHON=python3.12 $(MAKECMDGOALS)" if sys.version_info < (3, 11) else 0)'
	@echo "Making a Python environment in $(VENV): some seconds."
	@$(PYTHON) -m venv $(VENV)

$(VENV)/installed: $(PINS) | $(BIN)/python
	@echo "Installing what painting needs, PyTorch and some 40 smaller packages: one to two minutes with pip, half a minute with uv."
	@$(ADD) .
	@echo "Painting a tiny picture, for which loops are compiled and brushes tabulated: half a minute, once."
	-@folder=$$(mktemp -d) && { $(FIRST) --out $$folder/tiny >$$folder/said 2>&1 || cat $$folder/said; rm -r $$folder; }
	@touch $@

$(VENV)/web: $(VENV)/installed
	@echo "Installing what the studio's page needs: usually some seconds."
	@$(ADD) '.[web]'
	@touch $@

$(VENV)/dev: $(VENV)/installed
	@echo "Installing the test tools, all that commands may need, and a physics engine: usually one to two minutes more."
	@$(ADD) '.[dev]'
	@touch $@ $(VENV)/web

$(VENV)/nightly: $(VENV)/dev
	@echo "Installing what only the nightly run needs, 1.3 GB: Triton, a simulated Franka, the site's tools."
	@$(ADD) '.[nightly]'
	@touch $@ $(VENV)/docs

$(VENV)/docs: $(VENV)/installed
	@echo "Installing what makes the documentation's site: usually some seconds."
	@$(ADD) '.[docs]'
	@touch $@

paint: $(VENV)/installed
	@echo "Painting $(PHOTO): about a minute on a laptop with nothing else to do."
	@$(BIN)/frida-painter paint $(PHOTO)

studio: $(VENV)/web
	@$(BIN)/frida-painter studio

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python tools/check_words.py
	$(BIN)/python tools/check_page.py lint

# Pages of docs/reference that are made from the program itself. tests/docs fails if one is out of date.
reference: $(VENV)/web
	$(BIN)/python tools/write_reference.py

docs: $(VENV)/docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# The studio is tested in a real browser where there is one, or where it can be installed; elsewhere those tests skip.
browser:
	@command -v chromium >/dev/null || { [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null \
		&& apt-get -qq update && apt-get -qq install -y --no-install-recommends chromium; } || true

# Small networks and a grammar, by `frida-painter models fetch` into the user's cache folder: some seconds, once.
downloads: install
	@$(BIN)/python tests/downloads.py

test: lint browser downloads
	$(BIN)/python tools/check_page.py test
	$(BIN)/python tools/run_tests.py $(OPTIONS)

# With OPTIONS=--plain-processor, both round as a processor of another make does.
quick: install downloads
	$(BIN)/python tools/run_tests.py --quick $(OPTIONS)

# The whole suite with all packages and more examples of each property: `make test` skips what needs Triton, a
# simulated Franka, vpype or MkDocs.
nightly: $(VENV)/nightly
	@$(MAKE) test OPTIONS="--hypothesis-profile nightly $(OPTIONS)"

# Programs that attack, storm, stop, kill and starve the painter, and claims that hold in the mean of many paintings:
# hours with their defaults, so a nightly job runs them.
# One of them, with options: make stress PROGRAM=kills OPTIONS="--kills 20"
stress: $(VENV)/nightly browser downloads
	@for program in $(PROGRAM); do \
		$(BIN)/python tests/stress/$$program.py $(OPTIONS) || exit 1; done

views: install browser
	EVERY_VIEW=1 $(BIN)/python -m pytest tests/web/test_views.py

size:
	@$(PYTHON) tools/size.py $(if $(SINCE),--since $(SINCE))

benchmarks: install
	$(BIN)/python benchmarks/report.py

benchmarks-gpu: install
	$(BIN)/python benchmarks/report.py --only gpu

# Renews constraints.txt, for what pyproject.toml asks for now: two to four minutes. It needs uv.
# Newer versions: make pins OPTIONS="--upgrade-package NAME", or OPTIONS=--upgrade for all.
pins: $(BIN)/python
	@command -v uv >/dev/null || { echo "make pins needs uv: pip install uv"; exit 1; }
	@$(BIN)/python tools/lock.py $(OPTIONS)

clean:
	rm -rf $(VENV) build site *.egg-info
