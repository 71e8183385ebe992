.PHONY: help setup demo test test-slow test-newest test-all lint docs

help:
	@echo 'make demo   the whole job, small: world, training, secret training, navigation, table (out/demo/)'
	@echo 'make test   the quick tests: each rule, each protocol and each variant once'
	@echo 'make test-all   these, the slow ones (make test-slow), and those of the engine again on the newest JAX'
	@echo '           (make test-newest)'
	@echo 'make lint   ruff and pyright'
	@echo 'make docs   the documentation as a site (out/docs/)'
	@echo 'All of them first make .venv and install what is needed (scripts/setup).'

setup:
	@scripts/setup

demo: setup
	.venv/bin/ciphernav demo --out out/demo

test: setup
	.venv/bin/python -m pytest -n 2 --dist loadfile -m 'not slow'

test-slow: setup
	.venv/bin/python -m pytest -n 2 --dist loadfile -m slow

test-newest:
	@scripts/test-newest

test-all: test test-slow test-newest

lint: setup
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/pyright

docs: setup
	.venv/bin/python -m pip install --quiet --disable-pip-version-check --group docs
	.venv/bin/mkdocs build --strict
