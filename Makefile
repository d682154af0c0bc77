# make demo and make test work on a machine that has Python 3.11, make and git, and nothing else.
PYTHON ?= python3
VENV := .venv
RUNS := $(VENV)/.runs
TESTS := $(VENV)/.tests
INSTALL := $(VENV)/bin/pip install --quiet --disable-pip-version-check -c constraints.txt

.PHONY: demo test check setup clean

demo: $(RUNS)
	$(VENV)/bin/jenga demo

test: $(TESTS)
	$(VENV)/bin/pytest -n auto --dist loadfile

check: $(TESTS)
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/ruff check .
	$(VENV)/bin/pyright
	$(VENV)/bin/lint-imports

setup: $(TESTS)

# Made anew only when what is to be installed has changed. The demo needs no libraries of the tests.
$(RUNS): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "jenga needs Python 3.11 or newer; name one with: make PYTHON=python3.11"; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) -e .
	@touch $(RUNS)

$(TESTS): $(RUNS)
	$(INSTALL) -e '.[dev]'
	@touch $(TESTS)

clean:
	rm -rf $(VENV) .pytest_cache .ruff_cache .import_linter_cache
