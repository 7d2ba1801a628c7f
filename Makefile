.PHONY: help test lint types docs demo
PYTHON ?= $(HOME)/.local/share/vsx_ros/venv/bin/python3
export PYTHONPATH := src:hw

help:  ## this list
	@sed -n 's/^\([a-z]*\):.*##/\1:/p' Makefile | expand -t 10
demo:  ## an emulated robot explores a lab
	scripts/demo
test:  ## everything that must be green
	scripts/test
lint:  ## floor plan and style
	$(dir $(PYTHON))lint-imports && $(PYTHON) -m ruff check . && $(PYTHON) -m ruff format --check .
types:  ## mypy, strict
	$(PYTHON) -m mypy
docs:  ## write anew what is generated: the reference and the default parameters
	$(PYTHON) -m vsx_ros.cli.reference > docs/reference.md
	$(PYTHON) -m vsx_ros.cli.main config > config/default.yaml
