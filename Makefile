# `make repro` runs the whole experiment, `make test` the checks; both set up .venv first.

PYTHON ?= python3
# Which build of torch to install, before what requirements.lock lists: for example a CPU build's file (see the README).
TORCH ?= torch==2.13.0

VENV := .venv

# Relative, so that the shell needs no quotes, whatever the path of this folder has in it.
PIP := $(VENV)/bin/pip
INSTALLED := $(VENV)/installed
CHECKED := $(VENV)/params-checked
export PATH := $(CURDIR)/$(VENV)/bin:$(PATH)
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.PHONY: help install repro beyond quick record test types pytest wheel fuzz kill-test mutants verify benchmark words readme site console lock models initializers clean

help:  ## this list
	@sed -n 's/^\([a-z-]*\):.*##/\1:/p' $(MAKEFILE_LIST)

$(INSTALLED): requirements.lock pyproject.toml
	@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed: make PYTHON=python3.12 ...")'
	"$(PYTHON)" -m venv $(VENV)
	@echo "set-up: torch, then the $$(grep -c == requirements.lock) packages of requirements.lock; 2.6 GB in $(VENV)"
	$(PIP) install --no-deps $(TORCH)
	$(PIP) install --no-deps --require-hashes -r requirements.lock   # pip says which of them it is at
	$(PIP) install --quiet --editable '.[pipeline,test]'   # and what a CUDA build of torch wants besides
	@$(VENV)/bin/python -c 'import os, sysconfig; open(sysconfig.get_path("purelib") + "/isi_checkout.pth", "w").write(os.getcwd())'   # stages and tools, where PYTHONSAFEPATH is set
	@touch $@

$(CHECKED): params.yaml beyond/params.yaml $(INSTALLED)
	@python -m stages.check_params
	@touch $@

install: $(INSTALLED)  ## set up .venv

repro: $(CHECKED)  ## run all stages that are not up to date; print headline and path of the report, and how it differs from the committed one
	@python tools/repro.py
	@python -m tools.headline reports

beyond: $(CHECKED)  ## after repro, run the second pipeline: other embedding models, word vectors, graphs and conditions, with a page of its own
	@python -m stages.check_params beyond
	@$(MAKE) --no-print-directory repro
	@python tools/repro.py beyond/dvc.yaml

quick: $(CHECKED)  ## run the pipeline on a small grid in quick/, in about ten minutes (ARGS="--set initializers.es.k=4 --drop experiments.transfer" for other params)
	@python tools/workspace.py quick $(ARGS)
	@cd quick && python ../tools/repro.py
	@python -m tools.headline quick/reports

record: $(CHECKED)  ## record scenes of the live simulator (ARGS="--scenes FloorPlan1-3" instead of the params' list; see --help)
	@python -m stages.record $(ARGS)

test: $(INSTALLED)  ## ruff, mypy and pytest
	ruff check .
	ruff format --check .
	@$(MAKE) --no-print-directory --jobs types pytest

types: $(INSTALLED)
	mypy

pytest: $(INSTALLED)
	pytest --numprocesses auto --dist loadfile --no-loadscope-reorder

wheel: $(INSTALLED)  ## build the wheel and the source distribution, and check them, in dist/ (installs the extra `release`)
	$(PIP) install --quiet --editable '.[release]'
	rm -rf dist
	python -m build --no-isolation
	twine check --strict dist/*

fuzz: $(INSTALLED)  ## feed 10,000 malformed files to the readers, in about ten minutes (ARGS="--inputs 1000" for fewer); table in docs/benchmarks
	python -m tools.fuzz $(ARGS)

kill-test: $(INSTALLED)  ## kill 20 runs of a small pipeline at random moments and fill 8 disks, in about 20 minutes (ARGS="--kills 4" for fewer); table in docs/benchmarks
	python -m tools.kills $(ARGS)

mutants: $(INSTALLED)  ## mutation testing of the code that computes, in about an hour; table in docs/benchmarks (installs the extra `mutants`)
	$(PIP) install --quiet --editable '.[mutants]'
	mutmut run $(ARGS)
	python -m tools.mutants

verify: $(INSTALLED)  ## recompute vectors, the measure and epochs of the last run from its tables, with independent code, and compare
	@python -m tools.verify

benchmark: $(INSTALLED)  ## measure speed and memory, in about twelve minutes (installs the extra `benchmark`), into docs/benchmarks
	$(PIP) install --quiet --editable '.[benchmark]'
	@mkdir -p .benchmarks
	pytest -o addopts= tests/benchmarks --benchmark-only --benchmark-json=.benchmarks/latest.json
	python -m tools.benchmarks .benchmarks/latest.json

words: $(INSTALLED)  ## embed the phrases of data/raw/words again (installs the extra `words`)
	$(PIP) install --quiet --editable '.[words]'
	python -m tools.embed_phrases

readme: $(INSTALLED)  ## copy tables and numbers of the report and the benchmarks into the README and docs/
	python -m tools.docs

lock: $(INSTALLED)  ## write requirements.lock, with hashes, from the packages installed in .venv
	$(PIP) install --quiet uv
	$(PIP) freeze --exclude-editable | sed 's/+cpu$$//; /^uv==/d' > $(VENV)/frozen
	uv pip compile --quiet --no-deps --generate-hashes --no-header --no-annotate $(VENV)/frozen -o requirements.lock > /dev/null

site: $(INSTALLED)  ## build the documentation as a site for offline use, site/index.html (installs the extra `site`)
	$(PIP) install --quiet --editable '.[site]'
	NO_MKDOCS_2_WARNING=1 mkdocs build --quiet --strict
	pytest tests/test_site.py

console: $(INSTALLED)  ## run the commands of pages and copy their output there (installs the extra `words`)
	$(PIP) install --quiet --editable '.[words]'
	python -m tools.docs $$(grep -lr '^<!-- console:' README.md docs)

models: $(INSTALLED)  ## search learning rate, weight decay and margin of each embedding model, in about ten minutes
	python -m tools.choose_models

initializers: $(INSTALLED)  ## search the options of initializers on hidden entities, in about ten minutes
	python -m tools.choose_initializers

clean:  ## remove the environment and quick/
	rm -rf $(VENV) quick
