# Two commands: `make demo` and `make test`. Both set up what they need first.
PYTHON ?= python3
VENV   := .venv
READY  := $(VENV)/.ready

.PHONY: help setup kernels demo test lint lock clean firmware flash-transceiver

help:
	@echo "make demo            the whole mission on the simulated robot, in the operator's window"
	@echo "make demo HEADLESS=1 the same by itself without a display; pictures in out/demo"
	@echo "make test            set up, check the style, the types and the architecture, run all tests"
	@echo "make setup           make $(VENV) and install everything into it"
	@echo "make firmware        build the transceiver's firmware for the Arduino Mega; flash and RAM it takes"
	@echo "make flash-transceiver PORT=/dev/ttyACM0   build it and upload it"
	@echo "make lock            find new versions and write requirements/*.lock (needs uv)"
	@echo "make clean           remove $(VENV), out/ and build/"

setup: $(READY) kernels

$(READY): tools/setup/install.sh tools/setup/system-packages.txt requirements/workstation.lock pyproject.toml
	@PYTHON="$(PYTHON)" VENV="$(VENV)" sh tools/setup/install.sh

kernels: $(READY)
	@VENV="$(VENV)" sh tools/setup/compile_kernels.sh

demo: $(READY) kernels
	@HEADLESS="$(HEADLESS)" $(VENV)/bin/python -m tools.demo

lint: $(READY)
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/ruff check .
	$(VENV)/bin/mypy
	$(VENV)/bin/lint-imports

test: lint kernels
	$(VENV)/bin/python -m pytest

firmware:
	@PYTHON="$(PYTHON)" sh arduino/transceiver/build.sh

flash-transceiver: firmware
	@PORT="$(PORT)" sh arduino/transceiver/flash.sh

lock:
	uv pip compile --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-emit-find-links \
	    --no-annotate --no-header --upgrade --extra station --extra simulator --extra dev pyproject.toml \
	    -o requirements/workstation.lock
	uv pip compile --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-emit-find-links \
	    --no-annotate --no-header --upgrade --extra robot pyproject.toml -o requirements/robot.lock

clean:
	rm -rf $(VENV) out build
