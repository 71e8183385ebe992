.PHONY: help setup demo test lint

help:
	@echo 'make demo   the whole job, small: world, training, secret training, navigation, table (out/demo/)'
	@echo 'make test   the tests'
	@echo 'make lint   ruff and pyright'
	@echo 'All of them first make .venv and install what is needed (scripts/setup).'

setup:
	@scripts/setup

demo: setup
	.venv/bin/ciphernav demo --out out/demo

test: setup
	.venv/bin/python -m pytest -n 2 --dist loadfile

lint: setup
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/pyright
