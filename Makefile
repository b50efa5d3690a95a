# On a fresh machine each of these does all that it needs: `make ablation`, `make figures`, `make test`.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/.ready
# what is imported is compiled then: half of a set-up's computing went into files that nobody opens
PIP := --quiet --disable-pip-version-check --no-compile -c constraints.txt
export OPENBLAS_NUM_THREADS = 1
export OMP_NUM_THREADS = 1
# the tests start many programs: each would read the whole source again where nothing compiled may be kept
export PYTHONDONTWRITEBYTECODE =

.PHONY: ablation figures browser teach test test-portable test-slow lint docs evidence bench bench-huge notebooks clean

ablation: $(READY)  ## the main job on its defaults: a table, results/ablation/*.csv and a figure
	$(BIN)/qlearn ablate --out results/ablation

figures: $(READY)  ## the paper's figures 2, 3 and 4 with intervals, 20 runs a point (under half an hour on two cores)
	$(BIN)/qlearn figures --out results/figures

browser:  ## the browser that the tests of the page and of the widget drive (Debian; without it they are skipped)
	@command -v chromium-headless-shell >/dev/null || { \
	  sudo=$$([ "$$(id -u)" = 0 ] || echo sudo); \
	  $$sudo apt-get update -qq && $$sudo apt-get install -y -qq --no-install-recommends chromium-headless-shell fonts-dejavu-core; }

PROBLEM ?= icu-sepsis
teach: $(READY)  ## you are the tutor: prints the address of a page; make teach PROBLEM=options.csv asks about your own
	$(BIN)/qlearn teach --web --problem $(PROBLEM)

WORKERS ?= auto
test: $(READY)  ## the tests, without the slow ones
	$(BIN)/python -m pytest -q -n $(WORKERS) --dist worksteal

FOLDERS ?= tests
# one process compiles what its tests need, several would compile it several times
test-portable: $(READY)  ## fewer of them, as on an older processor: make test-portable FOLDERS=tests/elicit/lp for some
	$(if $(filter 0,$(WORKERS)),,$(BIN)/python -m tests.older_processor $(BIN)/python -m qlearn.warm_up)
	$(BIN)/python -m tests.older_processor $(BIN)/python -m pytest -q -n $(WORKERS) --dist worksteal $(FOLDERS)

test-slow: $(READY)  ## every test
	$(BIN)/python -m pytest -q -n auto --dist worksteal -m "slow or not slow"

lint: $(READY)  ## ruff and mypy
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

docs: $(READY)  ## the site in build/docs, without a warning
	$(BIN)/python -m sphinx -q -E -W --keep-going -c docs -d build/doctrees . build/docs

evidence: $(READY)  ## every page and figure of results that is of older code, page by page: hours, and the same command goes on
	$(BIN)/python -m pip install $(PIP) -e '.[peers]'
	$(BIN)/python docs/pictures/draw.py
	$(BIN)/python -m benchmarks.quotes
	$(BIN)/python -m benchmarks.evidence --all

bench: $(READY)  ## what learning, comparisons and fits cost, against other libraries (most of an hour): benchmarks/RESULTS*.md, docs/exploration.md
	$(BIN)/python -m pip install $(PIP) -e '.[peers]'
	$(BIN)/python -m benchmarks.evidence --fresh --only RESULTS RESULTS-ivi RESULTS-lp exploration RESULTS-bradley-terry

bench-huge: $(READY)  ## value iteration and policy iteration with a million states: up to two hours, one thread, 4 GiB
	$(BIN)/python -m pip install $(PIP) -e '.[peers]'
	$(BIN)/python -m benchmarks.evidence --fresh --only RESULTS-ivi-huge RESULTS-scale

notebooks: $(READY)  ## run the notebooks at their full setting, in place
	$(BIN)/python -m notebooks.execute

$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or later is needed; name one with: make PYTHON=python3.12"; exit 1; }
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install $(PIP) --upgrade pip  # an old one takes long to choose versions
	$(BIN)/python -m pip install $(PIP) -e .
	@# the tests are read once here, beside the compiler: else each of their processes would rewrite all their asserts
	$(BIN)/python -m qlearn.warm_up & compiling=$$!; \
	  $(BIN)/python -m pip install $(PIP) 'elicit-qlearn[dev]' \
	  && { $(BIN)/python -m pytest -q --collect-only >/dev/null || true; } && wait $$compiling
	touch $@

clean:
	rm -rf .venv results build .pytest_cache .mypy_cache .ruff_cache .hypothesis
