# The ways in. Needs Python 3.11 or newer with venv, a C compiler and make; all else goes into .venv.

PYTHON  ?= python3
# Installs the packages if it exists, else pip does. `make UV= ...` uses pip.
UV      ?= $(shell command -v uv)

VENV    := .venv
BIN     := $(VENV)/bin
# Three stamps: the packages of the run time and the report, the project itself, and all other packages.
PINNED  := $(VENV)/.pinned
RUN     := $(VENV)/.run
READY   := $(VENV)/.ready
by_uv    = $(UV) pip install --python $(BIN)/python $(1) || { echo "uv failed; add UV= to use pip, whose settings uv does not read" >&2; exit 2; }
by_pip   = $(BIN)/python -m pip --disable-pip-version-check install --no-compile $(1)
# Both show their progress on a terminal.
install  = $(call $(if $(UV),by_uv,by_pip),--no-deps $$([ -t 2 ] || echo -q) $(1))

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: $(shell awk -F: '/^[a-z-]+:/ { print $$1 }' $(MAKEFILE_LIST))

help: ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-12s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

sil: $(RUN) ## solve the paper's three maps, build the C, run C1 and C2, plot; results under build/
	@$(BIN)/codegen paper -o build

docs: $(READY) ## the guide, as pages to open from disk: build/docs/index.html; writes the parts of docs/ that come from the code
	@$(BIN)/python -m scripts.guide
	@$(BIN)/python -m sphinx -q -W --keep-going -b html docs build/docs
	@echo "the guide: build/docs/index.html"

screenshots: sil docs ## report, explorer and guide as pictures at three widths, to be looked at; needs Chromium
	@$(BIN)/python scripts/screenshots.py build/screenshots

test: $(READY) ## the tests that every change needs; minutes
	@$(BIN)/python -m pytest -n auto -qq

evidence: $(READY) ## what a release needs, with records in docs/evidence; PART=name for one part, QUICK=1 as CI runs it, FILES=DIR for public files
	@$(BIN)/python -m tests.evidence $(PART) $(if $(QUICK),--quick) $(if $(FILES),--files "$(FILES)")

check: $(READY) ## lint, format and types, nothing changed
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy

bench: $(READY) ## the benchmarks that every machine can run, also into benchmarks/results.md; half an hour
	@$(BIN)/python -m benchmarks --write benchmarks/results.md

bench-can: $(READY) ## the bench on vcan0: lock-step against real time, punctuality by the clock
	@$(BIN)/python -m tests.evidence.vcan.vcan_run -- $(BIN)/python -m benchmarks can

COMPILE := $(UV) pip compile --quiet --universal --fork-strategy fewest --generate-hashes --no-emit-index-url --no-emit-find-links \
	--custom-compile-command "make lock"

lock: ## both lock files from pyproject.toml (with UPGRADE=1: newest versions); needs uv
	@[ "$(UV)" ] || { echo "uv is missing: install it, e.g. pipx install uv" >&2; exit 2; }
	@$(COMPILE) --all-extras $(if $(UPGRADE),--upgrade) pyproject.toml -o requirements.lock
	@printf 'hatchling\neditables\n' | $(COMPILE) --extra report --no-annotate -c requirements.lock pyproject.toml - -o requirements-run.lock

generated: $(READY) ## the committed reference output in generated/, the pictures of README and guide, and its reference pages
	@$(BIN)/codegen solve --case 4ws-2 -o generated/4ws2-paper.npz
	@$(BIN)/codegen build --map generated/4ws2-paper.npz -o generated/4ws2-paper
	@rm -rf build/recommended && $(BIN)/codegen init build/recommended >/dev/null
	@$(BIN)/codegen solve --config build/recommended/ars.toml --case 4ws-2 -o generated/4ws2.npz
	@$(BIN)/codegen tune --map generated/4ws2.npz -o generated/4ws2.npz
	@$(BIN)/codegen build --map generated/4ws2.npz -o generated/4ws2
	@$(BIN)/codegen suite tracking --build generated/4ws2 --json --plot docs/images/tracking.png >build/tracking.json \
		|| test $$? = 1  # a missed requirement
	@$(BIN)/codegen suite references --build generated/4ws2 --plot docs/images/references.png >docs/suites/references.txt
	@$(BIN)/codegen sil --build generated/4ws2-paper --can --scenario ecu-loss --plot docs/images/ecu-loss.png >/dev/null
	@$(BIN)/python -m scripts.guide --suite build/tracking.json --figures

cars: $(READY) ## the record of the suite of random cars in the guide; ten minutes
	@mkdir -p build
	@$(BIN)/codegen suite cars --cars 40 --seed 4 --json >build/cars.json || test $$? = 1  # a missed limit
	@$(BIN)/python -m scripts.guide --cars build/cars.json

wheel: $(READY) ## sdist, and the wheel built from it, in dist/
	@$(BIN)/python -m build --no-isolation --outdir dist

clean: ## remove what was made, except .venv
	rm -rf build dist .mypy_cache .pytest_cache .ruff_cache .hypothesis .coverage *.egg-info
	find . -path ./$(VENV) -prune -o -type d -name __pycache__ -exec rm -rf {} +

venv: $(READY) ## .venv with the project and all its tools

preflight:
	@sh scripts/preflight.sh "$(PYTHON)"

$(PINNED): requirements-run.lock requirements.lock | preflight
	@echo "Making $(VENV): $$(grep -c == $<) packages to run codegen, installed by $(if $(UV),uv,pip)."
	@$(PYTHON) -m venv --clear $(VENV)
	@$(call install,--require-hashes -r $<)
	@touch $@

$(RUN): pyproject.toml $(PINNED) | preflight
	@$(call install,-q --no-build-isolation -e .)
	@touch $@

$(READY): requirements.lock $(RUN) | preflight
	@echo "Completing $(VENV): $$(grep -c == $<) packages with those of tests, guide and tools, a minute or more the first time."
	@$(call install,--require-hashes -r $<)
# Python that may not keep what it compiles would compile every package in every process.
	@$(if $(PYTHONDONTWRITEBYTECODE),$(BIN)/python -m compileall -q -j 0 $(VENV)/lib >/dev/null || true)
	@touch $@
