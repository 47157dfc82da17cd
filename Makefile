# Two commands are enough: `make demo` and `make test`. Nothing here needs root or a network beyond the package index.

PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
SOURCES := pyproject.toml hatch_build.py message_spec/ridlink.xml message_spec/generate.py

# The pure core, which the tests must cover by branches. Compiled kernels cannot be traced: see `make coverage`.
# Flights that reach no branch of their own bear the mark no_cover, for tracing doubles their time.
KERNELS := ridlink/avoidance/contact.py,ridlink/avoidance/encounter.py,ridlink/avoidance/evasion.py,ridlink/avoidance/graded.py,ridlink/avoidance/halfplane.py,ridlink/avoidance/headings.py,ridlink/avoidance/meeting.py,ridlink/avoidance/packing.py,ridlink/avoidance/priority.py,ridlink/avoidance/programme.py,ridlink/avoidance/reach.py,ridlink/avoidance/rotation.py,ridlink/avoidance/sift.py,ridlink/avoidance/turning.py,ridlink/avoidance/ways.py,ridlink/avoidance/worlds.py
CORE    := ridlink/errors.py,ridlink/units.py,ridlink/geodesy.py,ridlink/mavlink/*,ridlink/remote_id/*,ridlink/traffic/*,ridlink/separation/*,ridlink/avoidance/*,ridlink/own_ship/*,ridlink/failsafe.py,ridlink/setpoint.py,ridlink/engine/*
# The last line of defence, of which no branch may be left untested: what may leave, and what is believed.
DEFENCE := ridlink/failsafe.py,ridlink/setpoint.py,ridlink/own_ship/*,ridlink/traffic/*,ridlink/engine/commands.py,ridlink/engine/guard.py,ridlink/engine/guarding.py,ridlink/engine/intake.py,ridlink/engine/recovery.py,ridlink/engine/takeoff.py,ridlink/mavlink/frames.py,ridlink/mavlink/signing.py,ridlink/remote_id/accuracy.py,ridlink/remote_id/assembler.py,ridlink/remote_id/convert.py,ridlink/remote_id/identities.py,ridlink/remote_id/location.py,ridlink/remote_id/mavlink_fields.py,ridlink/remote_id/quantities.py,ridlink/remote_id/report.py,ridlink/remote_id/separation.py,ridlink/remote_id/system.py,ridlink/separation/definitions.py
CORE_TESTS := tests/mavlink tests/remote_id tests/traffic tests/separation tests/avoidance tests/engine tests/own_ship tests/test_errors.py tests/test_failsafe.py tests/test_geodesy.py tests/test_periodic.py tests/test_setpoint.py tests/test_units.py
WORKERS ?= 2
# Other tests mostly wait: for vehicles that fly in real time, for processes, for timeouts.
WAITING ?= 4
# Of `make e2e`: nothing for all acceptance flights, quick for one seed each, none.
FLIGHTS ?=

# Programs start twice as fast from byte code that is kept, whatever the shell says; `make clean` removes it.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test programs lint coverage bench e2e soak proof mutation clean help

help:
	@echo "make demo   install into $(VENV), fly 8 emulated vehicles through one point, and show them in a browser"
	@echo "make test   install the test extras, run linters, type checks and every test but those of"
	@echo "make programs  demos, campaigns, clusters and MAVSDK flights as whole programs"
	@echo "make coverage  branch coverage of the kernels, run as plain Python"
	@echo "make bench  print the benchmark tables"
	@echo "make e2e    look at the page in Chromium, fly the acceptance flights in real time (about 20 minutes)"
	@echo "make soak   fly for half an hour, feed a million damaged inputs to the readers and as many datagrams to a daemon, a hundred thousand to a vehicle, fly 680 times without and behind a bad network, 150 times on missions with guards, and 40 times as programs of their own"
	@echo "make proof  take the protections of docs/faults.md out one at a time, and see the test of each fail (quarter of an hour)"
	@echo "make mutation  change the last line of defence operator by operator, and see how much of it tests notice (half an hour)"
	@echo "make lint   ruff and mypy alone"
	@echo "make clean  remove what the build and the tests left"

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "ridlink needs Python 3.11 or newer; say which with: make $(MAKECMDGOALS) PYTHON=python3.12"; exit 2; }
	@echo "Making a virtual environment in $(VENV) ..."
	@$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: $(BIN)/python $(SOURCES)
	@echo "Installing ridlink and what it needs into $(VENV) (about a minute the first time) ..."
	@$(BIN)/python -m pip install --disable-pip-version-check --progress-bar off -e '.[web]'
	@touch $@

$(VENV)/.installed-dev: $(VENV)/.installed
	@echo "Installing the test extras (ruff, mypy, pytest, hypothesis, mavsdk, pyarrow, a broker, ...) ..."
	@$(BIN)/python -m pip install --disable-pip-version-check --progress-bar off -e '.[dev,mavsdk,export]'
	@touch $@

demo: $(VENV)/.installed
	@$(BIN)/ridlink demo

lint: $(VENV)/.installed-dev
	@echo "ruff ..."
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@echo "mypy ..."
	@$(BIN)/mypy ridlink sitl_sim message_spec examples

test: lint
	@echo "pytest, the pure core (its kernels are compiled once, which takes half a minute) ..."
	@$(BIN)/python -m pytest -q -n $(WORKERS) --cov --cov-report= $(CORE_TESTS)
	@echo "Branch coverage of the pure core by its own tests, at least 90 % (compiled kernels: make coverage) ..."
	@$(BIN)/coverage report --include='$(CORE)' --omit='ridlink/mavlink/dialect.py,$(KERNELS)' --skip-covered --fail-under=90
	@echo "Branch coverage of the last line of defence, 100 % ..."
	@$(BIN)/coverage report --include='$(DEFENCE)' --skip-covered --fail-under=100
	@echo "pytest, everything else ..."
	@$(BIN)/python -m pytest -q -n $(WAITING) --dist worksteal -m 'not e2e and not programs' $(addprefix --ignore=,$(CORE_TESTS))

programs: $(VENV)/.installed-dev
	@echo "pytest, whole programs ..."
	@$(BIN)/python -m pytest -q -n $(WAITING) --dist worksteal -m programs $(addprefix --ignore=,$(CORE_TESTS))

coverage: $(VENV)/.installed-dev
	@echo "The kernels as plain Python, so that they can be traced ..."
	@NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest -q --cov=ridlink.avoidance --cov-report= \
	  tests/avoidance/test_programme.py tests/avoidance/test_solver.py tests/avoidance/test_obstacles.py tests/avoidance/test_ways.py \
	  tests/avoidance/test_evasion.py tests/avoidance/test_headings.py tests/avoidance/test_reference.py tests/avoidance/test_priority.py
	@NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest -q --cov=ridlink.captures.fast --cov-append --cov-report= \
	  tests/captures/test_fast.py tests/captures/test_columns.py tests/captures/test_export.py
	@$(BIN)/coverage report --include='$(KERNELS),ridlink/captures/fast/*' --omit='ridlink/avoidance/worlds.py' --fail-under=90

bench: $(VENV)/.installed-dev
	@$(BIN)/python -m tests.bench

e2e: $(VENV)/.installed-dev
	@$(BIN)/python -m pytest -q -s -m e2e tests/e2e
	@test '$(FLIGHTS)' = none || $(BIN)/python -m tests.e2e $(FLIGHTS)

soak: $(VENV)/.installed-dev
	@$(BIN)/python -m tests.soak
	@$(BIN)/python -m tests.soak.fuzz
	@$(BIN)/python -m tests.soak.hostile
	@$(BIN)/python -m tests.soak.emulator
	@$(BIN)/python -m tests.soak.flights broadcast
	@$(BIN)/python -m tests.soak.flights lossy
	@$(BIN)/python -m tests.soak.guards
	@$(BIN)/python -m tests.soak.processes

proof: $(VENV)/.installed-dev
	@$(BIN)/python -m tests.soak.proof

mutation: $(VENV)/.installed-dev
	@$(BIN)/python -m tests.soak.mutation

clean:
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis .coverage ridlink/mavlink/dialect.py
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
