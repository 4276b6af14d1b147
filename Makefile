# Owns: setting up, checking, installing. `make help` lists what there is.
# Everything happens in the virtual environment .venv, which is made when it is first needed;
# only `make install` writes outside of this folder.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
ROOTS := daemon hal tests hatch_build.py

# A shell that forbids bytecode would have each test process compile all that it imports.
unexport PYTHONDONTWRITEBYTECODE

# Where `make install` puts things; DESTDIR goes in front of each, for packagers.
DESTDIR ?=
PREFIX := /opt/etd
UNIT_DIR := /etc/systemd/system
UNITS := etd-engine@.service etd-gateway@.service etd@.target

.DEFAULT_GOAL := help
.PHONY: help demo check test test-models test-pages compiled test-compiled compiled-arm test-compiled-arm test-client durations static format-check lint types contracts kernel-test kernel-mutants kernel-test-pi mutants bench instructions wall bench-calibrate bench-fit bench-steady bench-felt bench-finger bench-attack soak evidence campaign fuzz kills record compare format install place activate uninstall clean
.SUFFIXES:
.DELETE_ON_ERROR:

help: ## Show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-17s %s\n", $$1, $$2 }' Makefile

demo: $(VENV)/ready-daemon ## A moving pattern on the fake board, live in the terminal (SECONDS=10: for so long)
	$(BIN)/etd demo $(if $(SECONDS),--seconds $(SECONDS))

# Three workers for two cores, since many tests wait for a process that they have started; an idle
# worker takes over tests of another. In any order, as always.
WORKERS := $(shell expr $$(nproc) \* 3 / 2)
PYTEST := $(BIN)/pytest -q --numprocesses $(WORKERS) --dist worksteal
MODELS := tests/models
PAGES := tests/pages
APART := --ignore $(MODELS) --ignore $(PAGES)
# Not even imported by `check`: files that say of themselves that they are slow.
SLOW = $(addprefix --ignore ,$(shell grep -rl --include='test_*.py' '^pytestmark = .*pytest\.mark\.slow' tests))

# What a target took is said however it ends.
define timed
@begun=$$(date +%s); { $(1); }; status=$$?; echo "make $@: $$(($$(date +%s) - begun)) s"; exit $$status
endef

check: $(VENV)/ready-dev ## Before a commit, in a minute: format, lint, types, contracts, the fast tests
	$(call timed,$(STATIC) && $(PYTEST) $(SLOW) $(APART) $(ARGS))

test: $(VENV)/ready-dev ## Everything a change must pass: the same, and all tests but whole models and the pages'
	$(call timed,$(STATIC) && $(PYTEST) $(APART) $(ARGS))

test-models: $(VENV)/ready-dev ## Fingers and slow machines modelled for minutes, sweeps of whole self-tests, the benchmarks' own tests
	$(call timed,$(PYTEST) $(MODELS) $(ARGS))

test-client: $(VENV)/ready-dev ## The client on the Python that it keeps to, beside a fake daemon of ours (PYTHON310=python3.10)
	PYTHONPATH=tests $(BIN)/python tests/client_on.py $(or $(PYTHON310),python3.10)

test-pages: $(VENV)/ready-dev ## The examples, and what the pages show, as they stand there
	$(call timed,$(PYTEST) $(PAGES) $(ARGS))

durations: $(VENV)/ready-dev ## What each file of tests takes of the processor, and which are slow
	PYTHONPATH=tests $(PYTEST) -p processor_time $(ARGS)

# What needs no test to run. Side by side, each said whole.
STATIC = $(MAKE) --no-print-directory --jobs --output-sync=target static
static: format-check lint types contracts

format-check: $(VENV)/ready-dev
	@$(BIN)/ruff format --check $(ROOTS)

lint: $(VENV)/ready-dev
	@$(BIN)/ruff check $(ROOTS)

# Then what the client loads, for the Python that it keeps to.
types: $(VENV)/ready-dev
	@$(BIN)/mypy $(ROOTS)
	@files=$$($(BIN)/python tests/client_modules.py) && $(BIN)/mypy --python-version 3.10 --follow-imports=silent $$files

contracts: $(VENV)/ready-dev
	@$(BIN)/lint-imports --no-logo

# What must hold of both: the same sources, compiled and interpreted.
COMPILED := $(CURDIR)/build/compiled
SCENES := build/scenes
BOTH := tests/test_compiled.py tests/stabilize $(addprefix tests/hal/test_,guard.py guard_form.py guard_probe.py \
  guard_rate.py guard_blanked.py switch_shadow.py visitrule.py board.py cut.py safe_off.py) \
  $(addprefix tests/daemon/test_,clearance.py conductance.py engine_faults.py engine_limits.py engine_oracle.py \
  engine_properties.py engine_stabilize_properties.py firing.py ledger.py ledger_properties.py limits.py \
  plan.py plan_again_properties.py return_share.py soft_start.py)

# Of these what computes: the emulated processor takes ten minutes for them.
BOTH_ON_ARM := tests/test_compiled.py tests/stabilize $(addprefix tests/daemon/test_,clearance.py conductance.py \
  engine_oracle.py firing.py ledger.py ledger_properties.py limits.py plan.py return_share.py soft_start.py)

compiled: $(VENV)/ready-dev ## Compile what runs for each pulse, beside the sources (build/compiled); minutes
	$(BIN)/python hatch_build.py $(COMPILED)

test-compiled: compiled ## That compiled code behaves as interpreted: properties, oracle, guard, and every scene
	PYTHONPATH=$(COMPILED) $(PYTEST) $(BOTH) $(ARGS)
	rm -rf $(SCENES)
	$(BIN)/python tests/scenes/record.py $(SCENES)/interpreted
	PYTHONPATH=$(COMPILED) $(BIN)/python tests/scenes/record.py $(SCENES)/compiled
	$(BIN)/python tests/scenes/compare.py $(SCENES)/interpreted $(SCENES)/compiled

compiled-arm: $(VENV)/ready-dev ## The same for 64-bit ARM (build/compiled-arm; docs/kernel-rig.md)
	$(BIN)/python tests/kernel/build_arm.py $(COMPILED)-arm

test-compiled-arm: compiled-arm ## That it computes there what it computes here, by an emulated processor: laws, limits, ledger, plan, oracle
	$(BIN)/python tests/kernel/arm_program.py --compiled -m pytest -q -p no:cacheprovider $(BOTH_ON_ARM) $(ARGS)

kernel-test: $(VENV)/ready-dev ## Our drivers against real Linux kernels, in virtual machines (docs/kernel-rig.md; ARGS='--guest uml')
	$(BIN)/python tests/kernel/check.py $(ARGS)

kernel-mutants: $(VENV)/ready-dev ## Break the drivers line by line: a kernel test must see each (docs/kernel-rig.md)
	$(BIN)/python tests/kernel/mutants.py

kernel-test-pi: $(VENV)/ready-dev ## The same under the Pi's own drivers, on an emulated Raspberry Pi 3 (docs/kernel-rig.md)
	$(BIN)/python tests/kernel/pi_check.py

mutants: $(VENV)/ready-dev ## One mistake after another in what bounds current: a test must see each (ARGS='guard', --changed, --coverage, --json); an hour for all
	$(BIN)/python tests/mutants/run.py $(ARGS)

bench: $(VENV)/ready-dev ## Measure against the physical limit and the usual script (ARGS=--json)
	$(BIN)/python tests/bench/run.py $(ARGS)
	$(if $(findstring json,$(ARGS)),,-$(BIN)/python hatch_build.py $(COMPILED))
	$(if $(findstring json,$(ARGS)),,$(BIN)/python tests/bench/both.py)
	$(if $(findstring json,$(ARGS)),,$(BIN)/python tests/bench/recording.py)

instructions: $(if $(findstring --arm,$(ARGS)),compiled-arm,compiled) ## The engine's instructions for a pulse, by valgrind (ARGS='--arm --tree FOLDER': of 64-bit ARM, and of another checkout)
	$(BIN)/python tests/bench/instructions.py $(ARGS)

wall: $(VENV)/ready-dev ## The engine beside a hog, on wall-clock ports: it must not halt (SECONDS=900; ARGS=--threads: it must wait for the lock)
	$(BIN)/python tests/bench/wall_scene.py --seconds $(or $(SECONDS),120) $(ARGS)

bench-fit: $(VENV)/ready-dev ## Who gets an exponent k by `etd calibrate --fit`: 200 persons with one and without, and fingers of three kinds (ARGS='--of area --fingers 10')
	$(call timed,$(BIN)/python tests/bench/fit.py $(ARGS))

bench-calibrate: $(VENV)/ready-dev ## Calibrate persons who answer badly, and whole modelled bodies, by each method (minutes)
	$(BIN)/python tests/bench/calibrate_persons.py
	$(BIN)/python tests/bench/calibrate.py $(ARGS)

bench-steady: $(VENV)/ready-dev ## What each stabilizer gives and takes on bodies that disagree; an hour, goes on where it was cut (ARGS=--short: minutes; ARGS=--unbroken: the nearest law, whole)
	$(BIN)/python tests/bench/steady_bodies.py $(ARGS)

campaign: $(VENV)/ready-dev ## Every fault that the fake can show, at every place of a person's use; goes on where it was cut (ARGS='--part 100': minutes)
	$(BIN)/python tests/campaign/run.py $(ARGS)

soak: $(VENV)/ready-dev ## A daemon that plays for an hour beside a load, and a thousand starts (ARGS='--seconds 60 --restarts 10')
	$(BIN)/python tests/bench/soak.py $(ARGS)

kills: $(VENV)/ready-dev ## A thousand kills of each kind: what flows, how long until it is safe, what is remembered; an hour (ARGS='--kills 20')
	$(BIN)/python tests/bench/kills.py $(ARGS)

evidence: $(VENV)/ready-fuzz ## The figures on safety, measured now on this machine, into docs/evidence.md; hours (ARGS='--only kills attack', --short: minutes)
	$(BIN)/python tests/bench/evidence.py $(ARGS)

fuzz: $(VENV)/ready-fuzz ## Bytes from outside against every decoder and a whole engine, for an hour (SECONDS=600, ARGS='requests', ARGS=--list)
	$(BIN)/python tests/fuzz/run.py $(if $(SECONDS),--seconds $(SECONDS)) $(ARGS)

bench-attack: $(VENV)/ready-dev ## A stop, and the gateway's memory, while strangers do to the gateway what they can (ARGS=--json)
	$(BIN)/python tests/bench/attack.py $(ARGS)

bench-felt: $(VENV)/ready-dev ## What a person's answers give and take on bodies that disagree, in minutes (ARGS=--json)
	$(BIN)/python tests/bench/steady_felt.py $(ARGS)

bench-finger: $(VENV)/ready-dev ## How steady it feels on the fake's own finger, returns and plots included (ARGS=--json)
	$(BIN)/python tests/bench/steady.py $(ARGS)

record: $(VENV)/ready-dev ## Play many scenes on the fake, and keep traces and reports (OUT=folder)
	$(BIN)/python tests/scenes/record.py $(OUT)

compare: $(VENV)/ready-dev ## Whether two recordings are the same, renamed keys apart (OLD=folder NEW=folder)
	$(BIN)/python tests/scenes/compare.py $(OLD) $(NEW)

format: $(VENV)/ready-dev ## Put the code into the house's format
	$(BIN)/ruff format $(ROOTS)
	$(BIN)/ruff check --fix $(ROOTS)

clean: ## Remove what was made here, the virtual environment included
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	find $(ROOTS) -name __pycache__ -type d -prune -exec rm -rf {} +

# The stamps are younger than pyproject.toml, or the packages are installed again.
$(VENV)/ready-daemon: pyproject.toml | $(VENV)/bin/pip
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[daemon]'
	@touch $@

$(VENV)/ready-dev: pyproject.toml | $(VENV)/bin/pip
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@ $(VENV)/ready-daemon

$(VENV)/ready-fuzz: $(VENV)/ready-dev
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[dev,fuzz]'
	@touch $@ $(VENV)/ready-dev $(VENV)/ready-daemon

# Python is asked before venv is: a half-made environment would have to be cleaned up by hand.
define require_python
	@command -v $(PYTHON) >/dev/null || { \
	  echo "etd's daemon needs Python 3.11 or newer, and there is no $(PYTHON): sudo apt install python3 python3-venv"; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "etd's daemon needs Python 3.11 or newer, and $(PYTHON) is $$($(PYTHON) -V 2>&1): install a newer one and say make PYTHON=python3.11"; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	  echo "$(PYTHON) cannot make virtual environments: sudo apt install python3-venv"; exit 1; }
endef

$(VENV)/bin/pip:
	$(require_python)
	$(PYTHON) -m venv $(VENV)

install: ## Install the daemon for systemd on a Raspberry Pi (as root; DESTDIR= is understood)
	$(require_python)
	@test -n "$(DESTDIR)" || test "$$(id -u)" = 0 || { echo "this writes to $(PREFIX) and /etc: sudo make install"; exit 1; }
	@# What ProtectHome= of our units hides from them.
	@test -n "$(DESTDIR)" || $(PYTHON) -c 'import sys; sys.exit(sys.base_prefix.startswith(("/home/", "/root/")))' || { \
	  echo "$$($(PYTHON) -c 'import sys; print(sys.executable)') lies under /home or /root, which ProtectHome= hides from the services: make install PYTHON=/usr/bin/python3"; exit 1; }
	@{ command -v cc && $(PYTHON) -c 'import os, sys, sysconfig; sys.exit(not os.path.exists(sysconfig.get_path("include") + "/Python.h"))'; } >/dev/null || { \
	  echo "spidev is compiled when it is installed, and the compiler or Python's headers are missing: sudo apt install gcc python3-dev"; exit 1; }
	$(if $(DESTDIR),,@$(stop_engines))
	@echo "Installing; spidev is compiled for it, which takes minutes on a small machine."
	@# The services' users read what root writes, whatever root's own umask is.
	@umask 022 && $(MAKE) --no-print-directory place
	$(if $(DESTDIR),,@$(MAKE) --no-print-directory activate)
	@echo "Installed. Look at $(DESTDIR)/etc/etd/main.toml, then: sudo systemctl enable --now etd@main.target"
	@echo "Who may use it: sudo adduser NAME etd-users"

# An engine that runs needs its program until it has ended: ExecStopPost= is `etd safe`. What ran is
# named, and not started again: a board is armed only after a self-test of the new program.
define stop_engines
if [ -d /run/systemd/system ]; then \
  ran=$$(systemctl list-units --plain --no-legend --state=active,activating,reloading,deactivating 'etd@*.target' 'etd-gateway@*.service' 'etd-engine@*.service' | cut -d' ' -f1); \
  if [ -n "$$ran" ]; then \
    systemctl stop $$ran && echo "Stopped, because their program is replaced: $$ran"; \
  fi; \
fi
endef

# The files of `make install`, with a umask that lets others read them.
place:
	$(PYTHON) -m venv --clear $(DESTDIR)$(PREFIX)/venv
	$(DESTDIR)$(PREFIX)/venv/bin/pip install --quiet --disable-pip-version-check '.[pi]'
	@# A virtual environment knows its path: take DESTDIR out of it again.
	$(if $(DESTDIR),grep -rlI --include='*' '$(DESTDIR)' $(DESTDIR)$(PREFIX)/venv/bin $(DESTDIR)$(PREFIX)/venv/pyvenv.cfg | xargs -r sed -i 's|$(DESTDIR)||g')
	install -d $(DESTDIR)/usr/local/bin $(DESTDIR)/etc/etd
	ln -sfn $(PREFIX)/venv/bin/etd $(DESTDIR)/usr/local/bin/etd
	test -e $(DESTDIR)/etc/etd/main.toml || install -m 0644 config/etd.toml $(DESTDIR)/etc/etd/main.toml
	install -D -m 0644 -t $(DESTDIR)$(UNIT_DIR) $(addprefix systemd/,$(UNITS))
	install -D -m 0644 systemd/etd-spidev.conf $(DESTDIR)$(UNIT_DIR)/dev-spidev0.0.device.d/etd.conf
	install -D -m 0644 systemd/etd.sysusers.conf $(DESTDIR)/usr/lib/sysusers.d/etd.conf
	install -D -m 0644 systemd/etd.tmpfiles.conf $(DESTDIR)/usr/lib/tmpfiles.d/etd.conf
	install -D -m 0644 systemd/90-etd.rules $(DESTDIR)/usr/lib/udev/rules.d/90-etd.rules

# The running system takes up what was installed: the end of `make install`, and what a package does
# after unpacking what came out of a DESTDIR. Each step only where there is something to tell: a
# container has no udev and no systemd. Settled, so that the services can be started at once.
activate:
	systemd-sysusers etd.conf
	systemd-tmpfiles --create etd.conf
	if [ -d /run/udev ]; then udevadm control --reload && udevadm trigger --settle --subsystem-match=gpio --subsystem-match=spidev --subsystem-match=i2c-dev; fi
	if [ -d /run/systemd/system ]; then systemctl daemon-reload; fi

uninstall: ## Remove what install put there; settings, calibrations and records stay
	@test -n "$(DESTDIR)" || test "$$(id -u)" = 0 || { echo "this removes from $(PREFIX) and /etc: sudo make uninstall"; exit 1; }
	$(if $(DESTDIR),,if [ -d /run/systemd/system ]; then systemctl stop 'etd@*.target' 'etd-gateway@*.service' 'etd-engine@*.service'; fi)
	rm -rf $(DESTDIR)$(PREFIX)
	rm -f $(DESTDIR)/usr/local/bin/etd $(addprefix $(DESTDIR)$(UNIT_DIR)/,$(UNITS) multi-user.target.wants/etd@*.target)
	rm -f $(DESTDIR)$(UNIT_DIR)/dev-spidev0.0.device.d/etd.conf
	rmdir --ignore-fail-on-non-empty $(DESTDIR)$(UNIT_DIR)/dev-spidev0.0.device.d 2>/dev/null || true
	rm -f $(DESTDIR)/usr/lib/sysusers.d/etd.conf $(DESTDIR)/usr/lib/tmpfiles.d/etd.conf $(DESTDIR)/usr/lib/udev/rules.d/90-etd.rules
	$(if $(DESTDIR),,if [ -d /run/systemd/system ]; then systemctl daemon-reload; fi)
	@echo "Removed. Kept, because they are yours: $(DESTDIR)/etc/etd (settings), $(DESTDIR)/var/lib/etd-calibrations (calibrations of people), $(DESTDIR)/var/lib/etd (records)."
	@echo "Kept as well: the users etd-engine and etd-gateway and their groups."
