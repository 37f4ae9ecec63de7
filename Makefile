PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

# uv, where it is there, installs in a tenth of the time; pip does where uv cannot, as with an index
# that only pip is told of.
UV := $(shell command -v uv)
install = $(if $(UV),$(UV) pip install --quiet --python $(BIN)/python --requirement $(1) || )$\
	$(BIN)/python -m pip install --disable-pip-version-check --requirement $(1)

.PHONY: run test soak lint browser docs pictures benchmark audit clean

# The first page comes at once; what is not compiled yet is compiled beside it.
run: $(VENV)/.run
	$(BIN)/streamlit run app.py

# A process per core, each of one thread, which takes over tests that others have not begun. All is
# compiled before: else each process would compile for itself. Bytecode is kept, also where it is not
# otherwise: else each process reads all sources again, which was 8 s for each of those that test.
PYTEST := PYTHONDONTWRITEBYTECODE= OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest \
	--numprocesses auto --dist worksteal

test: $(VENV)/.dev $(VENV)/.compiled
	$(PYTEST) -m "not browser and not soak" --ignore tests/browser --ignore tests/soak

# Fuzzing, kills, faults at every disk call, many repeats. SOAK=short: a quarter of `test`.
SOAK ?= whole
soak: $(VENV)/.dev $(VENV)/.compiled
	STEREOCAL_SOAK=$(SOAK) $(PYTEST) -m soak

# All that is checked without running anything: style, layout, imports, types.
lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-logo
	$(BIN)/mypy

# A walk that fails is walked once more, and told: a busy machine is no fault of a page.
browser: $(VENV)/.dev
	$(PYTEST) -m browser --reruns 1 -rR

# The documentation site, in docs/_build; it needs no network.
docs: $(VENV)/.dev
	$(BIN)/python -m sphinx -W --keep-going docs docs/_build

# Every page at 1400 and 420 px, light and dark, and the drawings, into docs/pictures.
pictures: $(VENV)/.dev $(VENV)/.compiled
	$(BIN)/python -m docs.drawings
	$(BIN)/python -m docs.screenshots

benchmark: $(VENV)/.dev
	$(BIN)/python -m pytest benchmarks
	$(BIN)/python -m benchmarks.speed costs searches

# Known vulnerabilities of everything that requirements.txt brings; asks the package index.
audit: $(VENV)/.run
	$(PYTHON) -m venv $(VENV)/audit
	$(VENV)/audit/bin/python -m pip install --quiet pip-audit
	$(VENV)/audit/bin/pip-audit --strict --requirement requirements.txt

$(VENV)/.run: requirements.txt
	@$(PYTHON) -c 'import sys; sys.exit("This needs Python 3.11 or newer: make PYTHON=python3.12 ..." if sys.version_info < (3, 11) else 0)'
	@echo "Installing into $(VENV): about 300 MB to download, 1.1 GB on disk."
	$(PYTHON) -m venv $(VENV)
	$(call install,requirements.txt)
	@echo "Installed in $(VENV): $$(du -sh $(VENV) | cut -f 1)."
	@touch $@

$(VENV)/.dev: requirements-dev.txt requirements-docs.txt $(VENV)/.run
	$(call install,requirements-dev.txt)
	@touch $@

# Done once, and again after a change of the sources: then the first page does not wait for it.
$(VENV)/.compiled: $(VENV)/.run $(wildcard stereocal/*.py stereocal/*/*.py stereocal/*/*/*.py)
	$(BIN)/python -m stereocal compile
	@touch $@

clean:
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache
