# Everything runs in .venv, which the first of these commands makes: Python 3.11 or newer is all it takes.

PYTHON ?= $(shell for p in python3.11 python3; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
READY := .venv/ready
KERNELS := .venv/kernels
IN := .venv/bin/

.PHONY: help demo test check clean

help: ## Say what there is to make
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "make %-8s %s\n", $$1, $$2 }' Makefile

demo: $(READY) $(KERNELS) ## Train, recognise and re-enact simulated actions through a server
	$(IN)gesta demo

test: $(READY) $(KERNELS) ## Run the tests
	$(IN)pytest

check: $(READY) ## Check style, types and architecture
	$(IN)ruff check
	$(IN)ruff format --check
	$(IN)mypy
	$(IN)pytest --quiet tests/test_architecture.py

clean: ## Remove .venv and what the tools and the demo left
	rm -rf .venv .hypothesis .mypy_cache .pytest_cache .ruff_cache *.egg-info build dist demo
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(READY): pyproject.toml
	@test -n '$(PYTHON)' || { echo 'Gesta needs Python 3.11 or newer: make PYTHON=/path/to/python' >&2; exit 1; }
	@echo 'Setting up .venv, once: a minute or two'
	$(PYTHON) -m venv .venv
	$(IN)pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@

# What numba has compiled of a file does not hang on the files that it calls: after a change it all goes.
$(KERNELS): $(wildcard app/motion/*.py) | $(READY)
	@rm -f app/motion/__pycache__/*.nb?
	@touch $@
