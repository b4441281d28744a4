# Two commands: `make demo` and `make test`. Both set up what they need first.
PYTHON ?= python3
VENV   := .venv
READY  := $(VENV)/.ready

.PHONY: help setup kernels demo test lint lock clean firmware flash-transceiver image card

help:
	@echo "make demo            the whole mission on the simulated robot, in the operator's window"
	@echo "make demo HEADLESS=1 the same by itself without a display; pictures in out/demo"
	@echo "make demo LINK=lora  the same over emulated LoRa radios; LINK=switch: Wi-Fi that goes away, with LoRa beside it"
	@echo "make test            set up, check the style, the types and the architecture, run all tests"
	@echo "make setup           make $(VENV) and install everything into it"
	@echo "make firmware        build the transceiver's firmware for the Arduino Mega; flash and RAM it takes"
	@echo "make flash-transceiver PORT=/dev/ttyACM0   build it and upload it"
	@echo "make image BASE=raspios.img.xz WIFI=lab COUNTRY=JP KEY=~/.ssh/id_ed25519.pub PAIRING=pairing.pem"
	@echo "                     an image for the robot's card, out/robot.img; CONFIG=robot.toml for one of your own"
	@echo "make card CARD=/media/you/bootfs ...   the same on a card that Raspberry Pi OS was written to"
	@echo "make lock            find new versions and write requirements/*.lock (needs uv)"
	@echo "make clean           remove $(VENV), out/ and build/"

setup: $(READY) kernels

$(READY): tools/setup/install.sh tools/setup/system-packages.txt requirements/workstation.lock pyproject.toml
	@PYTHON="$(PYTHON)" VENV="$(VENV)" sh tools/setup/install.sh

kernels: $(READY)
	@VENV="$(VENV)" sh tools/setup/compile_kernels.sh

demo: $(READY) kernels
	@HEADLESS="$(HEADLESS)" LINK="$(LINK)" $(VENV)/bin/python -m tools.demo

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

CARD_OPTIONS = $(if $(HOST),--hostname $(HOST)) $(if $(KEY),--ssh-key $(KEY)) $(if $(WIFI),--wifi "$(WIFI)") \
    $(if $(COUNTRY),--country $(COUNTRY)) $(if $(PAIRING),--pairing $(PAIRING)) $(if $(CONFIG),--config $(CONFIG))

image: $(READY)
	@test -n "$(BASE)" || { echo "say which Raspberry Pi OS: make image BASE=raspios-lite-arm64.img.xz" >&2; exit 2; }
	@$(VENV)/bin/python -m tools.flash image $(BASE) --wheels build/wheels-aarch64 $(CARD_OPTIONS)

card: $(READY)
	@test -n "$(CARD)" || { echo "say where its boot partition is mounted: make card CARD=/media/you/bootfs" >&2; exit 2; }
	@$(VENV)/bin/python -m tools.flash card $(CARD) --wheels build/wheels-aarch64 $(CARD_OPTIONS)

lock:
	uv pip compile --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-emit-find-links \
	    --no-annotate --no-header --upgrade --extra station --extra simulator --extra dev pyproject.toml \
	    -o requirements/workstation.lock
	uv pip compile --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-emit-find-links \
	    --no-annotate --no-header --upgrade --extra robot pyproject.toml -o requirements/robot.lock

clean:
	rm -rf $(VENV) out build
