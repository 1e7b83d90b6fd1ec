# The ways in. Needs Python 3.11 or newer with venv, a C compiler and make; all else goes into .venv.

PYTHON ?= python3
UV     ?= uv

VENV   := .venv
BIN    := $(VENV)/bin
# Two stamps: what the lock file pins, and the project itself on top of it.
PINNED := $(VENV)/.pinned
READY  := $(VENV)/.ready
# -qq: errors only.
PIP    := $(BIN)/python -m pip --disable-pip-version-check install -qq

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: $(shell awk -F: '/^[a-z-]+:/ { print $$1 }' $(MAKEFILE_LIST))

help: ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-12s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

sil: $(READY) ## solve the paper's three maps, build the C, run C1 and C2, plot; results under build/
	@$(BIN)/codegen paper -o build

docs: $(READY) ## the guide, as pages to open from disk: build/docs/index.html
	@$(BIN)/python -m sphinx -q -W --keep-going -b html docs build/docs
	@echo "the guide: build/docs/index.html"

screenshots: sil docs ## report, explorer and guide as pictures at three widths, to be looked at; needs Chromium
	@$(BIN)/python scripts/screenshots.py build/screenshots

test: $(READY) ## the tests that every change needs; minutes
	@$(BIN)/python -m pytest -n auto -qq

evidence: $(READY) ## what a release needs, with records in docs/evidence; PART=name for one part, QUICK=1 for less of it
	@$(BIN)/python -m tests.evidence $(PART) $(if $(QUICK),--quick)

check: $(READY) ## lint, format and types, nothing changed
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy

bench: $(READY) ## the benchmarks that every machine can run, also into benchmarks/results.md; half an hour
	@$(BIN)/python -m benchmarks --write benchmarks/results.md

bench-can: $(READY) ## the bench on vcan0: lock-step against real time, punctuality by the clock
	@$(BIN)/python -m tests.evidence.vcan.vcan_run -- $(BIN)/python -m benchmarks can

lock: ## requirements.lock from pyproject.toml (with UPGRADE=1: newest versions); needs uv
	@command -v $(UV) >/dev/null || { echo "uv is missing: install it, e.g. pipx install uv" >&2; exit 2; }
	@$(UV) pip compile pyproject.toml --quiet --universal --fork-strategy fewest --all-extras --generate-hashes \
		--no-emit-index-url --no-emit-find-links --custom-compile-command "make lock" $(if $(UPGRADE),--upgrade) -o requirements.lock

generated: $(READY) ## the committed reference output in generated/, and README's pictures
	@$(BIN)/codegen solve --case 4ws-2 -o generated/4ws2-paper.npz
	@$(BIN)/codegen build --map generated/4ws2-paper.npz -o generated/4ws2-paper
	@rm -rf build/recommended && $(BIN)/codegen init build/recommended >/dev/null
	@$(BIN)/codegen solve --config build/recommended/ars.toml --case 4ws-2 -o generated/4ws2.npz
	@$(BIN)/codegen tune --map generated/4ws2.npz -o generated/4ws2.npz
	@$(BIN)/codegen build --map generated/4ws2.npz -o generated/4ws2
	@$(BIN)/codegen verify generated/4ws2-paper >/dev/null
	@$(BIN)/codegen verify generated/4ws2 >/dev/null
	@$(BIN)/codegen paper -o build >/dev/null
	@mkdir -p docs/images && cp build/overview.png docs/images/overview.png
	@$(BIN)/codegen sil --suite tracking --plot docs/images/tracking.png >/dev/null
	@$(BIN)/codegen sil --suite references --plot docs/images/references.png >/dev/null
	@$(BIN)/codegen sil --build generated/4ws2-paper --can --scenario ecu-loss --plot docs/images/ecu-loss.png >/dev/null

wheel: $(READY) ## sdist, and the wheel built from it, in dist/
	@$(BIN)/python -m build --no-isolation --outdir dist

clean: ## remove what was made, except .venv
	rm -rf build dist docs/_figures .mypy_cache .pytest_cache .ruff_cache .hypothesis .coverage *.egg-info
	find . -path ./$(VENV) -prune -o -type d -name __pycache__ -exec rm -rf {} +

venv: $(READY) ## .venv with the project and all its tools

preflight:
	@sh scripts/preflight.sh "$(PYTHON)"

$(PINNED): requirements.lock | preflight
	@echo "Making $(VENV): about 150 packages, a minute or more the first time."
	@$(PYTHON) -m venv --clear $(VENV)
	@$(PIP) --require-hashes -r requirements.lock
	@touch $@

$(READY): pyproject.toml $(PINNED) | preflight
	@$(PIP) --no-deps --no-build-isolation -e .
	@touch $@
