# Each target sets up what it needs in .venv, once, on a machine with Python >= 3.11 and make. constraints.txt pins it.
#   make demo                  the whole loop, with a report in out/demo
#   make test                  the fast tier: five minutes on two cores
#   make test-full             the rest of what CI runs
#   make test PYTEST="-m slow" other arguments for pytest
#   make docs                  the documentation as a site, in site/index.html
#   make notebooks             runs the notebooks of examples/notebooks again, in place, with their pictures: two minutes
#   make bench BENCH="--scaling -o out/bench"     other arguments for svbrdfgan bench
#   make bench REDNER=redner/bin/python           redner beside ours, from an environment of its own
#   make fuzz MINUTES=60       damaged files of all kinds; keeps in out/fuzz what is neither read nor refused
#   make PYTHON=python3.12 ... another Python
VENV ?= .venv
JOBS ?= 2
OUT ?= out/demo
PYTEST ?= -n $(JOBS) --dist worksteal
BENCH ?=
REDNER ?=
MINUTES ?= 10
SEED ?=

RUN := $(VENV)/bin
INSTALL := $(RUN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable
SUITABLE := import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))
PYTHON ?= $(firstword $(foreach name,python3 python3.13 python3.12 python3.11 python3.14 python,\
	$(shell $(name) -c '$(SUITABLE)' 2>/dev/null && echo $(name))))

.PHONY: demo test test-full lint types docs test-docs notebooks bench fuzz clean
.DELETE_ON_ERROR:

demo: $(VENV)/.demo
	$(RUN)/svbrdfgan demo --out $(OUT)

test: $(VENV)/.dev
	$(RUN)/python -m pytest $(PYTEST)

test-full: $(VENV)/.dev
	$(RUN)/python -m pytest -m "full and not slow" $(PYTEST)

lint: $(VENV)/.dev
	$(RUN)/ruff check .
	$(RUN)/ruff format --check .

types: $(VENV)/.dev
	$(RUN)/mypy

docs: $(VENV)/.dev
	NO_MKDOCS_2_WARNING=1 $(RUN)/mkdocs build --strict --quiet

test-docs: $(VENV)/.dev
	$(RUN)/python -m pytest -q -m "not slow" tests/docs

notebooks: $(VENV)/.dev
	GOMP_SPINCOUNT=3000 $(RUN)/jupyter execute --inplace examples/notebooks/*.ipynb

# Beside ours, the peers that are there: Mitsuba used directly where it is in the same environment, and redner.
bench: $(VENV)/.demo
	$(RUN)/svbrdfgan bench \
		$(if $(wildcard $(VENV)/lib/python*/site-packages/mitsuba),--peer "$(RUN)/python benchmarks/peer_mitsuba.py {scene} --spp {spp}") \
		$(if $(REDNER),--peer "$(REDNER) benchmarks/peer_redner.py {scene} --spp {spp}") \
		--history docs/lab/bench.jsonl $(BENCH)

fuzz: $(VENV)/.dev
	GOMP_SPINCOUNT=3000 $(RUN)/python -m tests.fuzz --minutes $(MINUTES) $(if $(SEED),--seed $(SEED))

clean:
	rm -rf $(VENV) site .mypy_cache .ruff_cache .pytest_cache

$(VENV)/bin/python:
	@test -n "$(PYTHON)" || { echo "no Python of at least 3.11 with venv was found; install one, or say make PYTHON=/path/to/python3" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)

# The demo's packages come first, so that `make demo` waits for nothing else.
$(VENV)/.demo: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(INSTALL) '.[warp,pictures,gltf]'
	@touch $@

$(VENV)/.dev: $(VENV)/.demo
	$(INSTALL) '.[dev]'
	@touch $@
