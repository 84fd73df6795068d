# Everything runs in a private environment, .venv, made from requirements.lock by the first target
# that needs it. Only Python 3.11 or newer with venv and pip, and make, are asked of the machine.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := PYTHONUNBUFFERED=1 $(BIN)/python -m pip --disable-pip-version-check
PROGRESS := awk '/^Collecting/ && ++n % 10 == 0 { print "  " n " packages"; fflush() } \
	/^Installing collected/ { print "  installing"; fflush() }'

# Small systems are solved faster without threads: see gcs_sysid/cli/numerics.py.
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: setup demo flights test lint format bench bench-arduplane bench-causes bench-faults bench-filter bench-maneuvers bench-thesis blind campaign fuzz pairs results picture report-pictures live-pictures docs lock clean

setup: $(VENV)/.installed

# The stamp is made on the left of the pipe, since sh reports only the right side's status.
$(VENV)/.locked: requirements.lock
	@rm -f $@
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "Python 3.11 or newer is needed: make PYTHON=/path/to/python3.11" >&2; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "Installing the locked packages into $(VENV) (a few minutes the first time)"
	@( $(PIP) install --require-hashes --progress-bar off -r requirements.lock && touch $@ ) | $(PROGRESS)
	@test -e $@

$(VENV)/.installed: $(VENV)/.locked pyproject.toml
	@$(PIP) install --quiet --no-build-isolation --no-deps --editable .
	@touch $@
	@echo "Ready: $(BIN)/gcs-sysid --help"

DEMO := out/demo
DEMO_AIRCRAFT := replay/ultra_stick_25e.toml

demo: setup
	@echo "An aircraft takes off whose elevator is weaker than its file says; nobody is told."
	@$(BIN)/gcs-sysid sitl --scenario replay/weak_elevator/scenario.toml --out $(DEMO)/flights
	@echo "What the first flight says:"
	@$(BIN)/gcs-sysid identify $(DEMO)/flights/first.tlog --aircraft $(DEMO_AIRCRAFT) \
		--out $(DEMO)/identify
	@echo "What to fly to know its pitching moment better:"
	@$(BIN)/gcs-sysid suggest --model $(DEMO)/identify --target Cm --out $(DEMO)/suggest
	@echo "What the simulation gets wrong; the second flight took no part:"
	@$(BIN)/gcs-sysid diagnose $(DEMO)/flights/first.tlog --aircraft $(DEMO_AIRCRAFT) \
		--method coefficients \
		--holdout $(DEMO)/flights/second.tlog --out $(DEMO)/diagnose

flights: setup
	@$(BIN)/gcs-sysid sitl --scenario replay/demo/scenario.toml

test: setup
	@$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder --require-shared

lint: setup
	@$(BIN)/ruff format --check .
	@$(BIN)/ruff check .
	@$(BIN)/ty check
	@$(BIN)/lint-imports

format: setup
	@$(BIN)/ruff format .
	@$(BIN)/ruff check --fix .

docs: setup
	@$(BIN)/python docs/cli_reference.py
	@$(BIN)/python -m sphinx -W --keep-going -q -b html docs docs/_build/html
	@echo "docs/_build/html/index.html"

bench: setup
	@for file in tests/benchmarks/bench_*.py; do $(BIN)/python $$file $(BENCH) || exit 1; done

# The published comparison on flights whose truth is known; runs stay in out/thesis.
bench-thesis: setup
	@$(BIN)/python tests/benchmarks/bench_thesis.py --out out/thesis $(BENCH)

# The filter against truth on flights of our own simulator: hours, finished fits are not repeated.
# The first is asked before the others: it knows the bounds of those whose mass is to be found.
bench-filter: setup
	@for asked in "--flights 100" "--flights 20 --told wrong" "--flights 20 --told coarse" \
		"--flights 10 --vanes" "--flights 8 --together 2"; do \
		$(BIN)/python tests/benchmarks/bench_filter_error.py $$asked $(BENCH) || exit 1; done

# Closed loop on the aircraft of data/: BENCH="--aircraft ultra_stick_25e --seeds 1" for a part,
# BENCH="--rounds 3 --seeds 1" for whole sorties one after the other.
bench-maneuvers: setup
	@$(BIN)/python tests/benchmarks/closed_loop.py $(BENCH)

# Flights in which something is hidden, diagnosed by a program that is not told what: a dozen.
blind: setup
	@$(BIN)/python -m tests.blind.campaign --dozen --again --out out/blind $(BENCH)

# What `diagnose` names in the scenarios of replay/: minutes each, finished ones are not repeated.
bench-causes: setup
	@$(BIN)/python tests/benchmarks/causes.py $(BENCH)

# What `diagnose` says of a recorded flight of ArduPlane's own simulation: some minutes; and of four
# minutes of it with a fault put in, a dozen of them: an hour.
bench-arduplane: setup
	@$(BIN)/python tests/benchmarks/arduplane.py $(BENCH)
bench-faults: setup
	@$(BIN)/python tests/benchmarks/arduplane_faults.py $(BENCH)

# Hundreds; finished ones are not repeated: BENCH="--count 200 --start 0 --cause none" for a part.
campaign: setup
	@$(BIN)/python -m tests.blind.campaign $(BENCH)

# Causes that are hard to tell apart, flown again as `suggest --separate` plans: BENCH="--only mass".
pairs: setup
	@$(BIN)/python -m tests.blind.pairs $(BENCH)

# Listening as its users run it, in real time and at ten times the rate, then hours of flight as fast
# as they go: HOURS=1 for the bench, ten for the soak, which goes on where it was stopped.
HOURS ?= 1
bench-live: setup
	@$(BIN)/python tests/benchmarks/bench_live.py $(BENCH)
	@rm -rf out/bench-live
	@$(BIN)/python tests/benchmarks/soak_live.py --hours $(HOURS) --out out/bench-live $(BENCH)

soak: HOURS = 10
soak: setup
	@$(BIN)/python tests/benchmarks/soak_live.py --hours $(HOURS) --out out/soak

# A recorded flight played to the link at its own timing, against the same file identified.
same-model: setup
	@$(BIN)/python tests/benchmarks/same_model.py $(LOG) $(AIRCRAFT) --out out/same-model

# Coverage-guided: damaged logs of every format, for so many seconds each.
FUZZ_SECONDS ?= 60
fuzz: setup
	@$(BIN)/python -m tests.fuzz.readers --seconds $(FUZZ_SECONDS)

results: BENCH = --save
results: bench
	@$(BIN)/python docs/results.py

picture: setup
	@$(BIN)/gcs-sysid identify data/flights/demo.tlog --aircraft data/aircraft/ultra_stick_25e.toml \
		--out out/picture
	@$(BIN)/python docs/picture.py out/picture data/flights/demo_truth.json

# What `make demo` flew, diagnosed by the filter, and its first test card: minutes, and Chromium.
report-pictures: demo
	@$(BIN)/gcs-sysid diagnose $(DEMO)/flights/first.tlog --aircraft $(DEMO_AIRCRAFT) \
		--holdout $(DEMO)/flights/second.tlog --out out/pictures/diagnose
	@$(BIN)/python -m docs.report_pictures out/pictures/diagnose/report.html \
		$(DEMO)/suggest/report.html

# A flight in real time, its page on a screen and a phone: two minutes, and Chromium.
live-pictures: setup
	@$(BIN)/python -m docs.live_pictures

# Universal: one file for every platform and Python version, with a hash for each archive.
lock:
	uv pip compile pyproject.toml --universal --all-extras --group dev --group test --group bench --group docs \
		--generate-hashes --no-emit-index-url --no-emit-find-links --no-header --quiet \
		--output-file requirements.lock

clean:
	rm -rf $(VENV) build dist docs/_build .pytest_cache .ruff_cache .hypothesis
