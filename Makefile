# `make flight-model`: set up everything and run the flight-model campaign to printed axes.
# `make test`: set up everything and pass the checks and the tests.

PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/ready
STORE := out/isa-flight-model.rig.sqlite

.PHONY: setup flight-model test lint types imports pytest clean

setup: $(READY)

$(READY): requirements.lock pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	touch $@

flight-model: setup
	mkdir -p out
	rm -f $(STORE) $(STORE)-wal $(STORE)-shm
	$(BIN)/rigctl run campaigns/isa-flight-model.toml --store $(STORE) --yes

test: lint types imports pytest

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: setup
	$(BIN)/mypy

imports: setup
	$(BIN)/lint-imports

pytest: setup
	$(BIN)/pytest -n 2

clean:
	rm -rf $(VENV) out .mypy_cache .ruff_cache .pytest_cache .hypothesis
