# `make flight-model`: set up everything and run the flight-model campaign to printed axes.
# `make test`: set up everything and pass the checks and the tests.

PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/ready
STORE := out/isa-flight-model.rig.sqlite

RELIABILITY := $(BIN)/python -m tests.reliability
TRIALS := out/reliability
TABLES ?= 500

# Programs that are started by the hundred, as tests do, are compiled once.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: setup wheel docs docs-figures certificates console-operator console-looks console-pictures flight-model test checks lint types imports pytest foreign dialects clients samples false-alarms metamorphic metamorphic-bundles missions old-processor reliability reliability-ci reliability-full limits clean laser-dialects wire-dialects

setup: $(READY)

$(READY): requirements.lock pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	touch $@

# dist/rigctl-VERSION-py3-none-any.whl: all that is needed to install it elsewhere.
wheel: setup
	$(BIN)/python -m build --quiet --wheel --no-isolation --outdir dist

flight-model: setup
	mkdir -p out
	rm -f $(STORE) $(STORE)-wal $(STORE)-shm
	$(BIN)/rigctl run campaigns/isa-flight-model.toml --store $(STORE) --yes

test: checks pytest

# Side by side: mypy alone takes as long as all others, on one core.
checks: setup
	$(MAKE) --no-print-directory --jobs 2 lint types imports

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: setup
	$(BIN)/mypy

imports: setup
	$(BIN)/lint-imports

# The site of docs/ in out/site, its notebook run; a link that leads nowhere, or a page that no contents lead to, is an error. Half a minute.
# A fresh one each time: pages that have not changed would not warn again.
docs: setup
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/sphinx-build --fail-on-warning --keep-going --quiet --fresh-env \
	  --doctree-dir out/site-doctrees docs out/site

# By files: what the tests of a file share, a measured campaign for example, is made once and not by each worker.
# Three workers on two cores: tests of the console and of served instruments wait as often as they work. One thread of
# linear algebra in each: threads that wait for one another cost a fifth of the processor time.
pytest: setup
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n 3 --dist loadfile --durations 40 --durations-min 10

# The suite with the arithmetic of a processor without AVX: numpy, OpenBLAS and numba round otherwise there. As long as the suite.
old-processor: setup
	NPY_DISABLE_CPU_FEATURES=X86_V3 OPENBLAS_CORETYPE=Nehalem NUMBA_CPU_NAME=generic $(MAKE) --no-print-directory pytest

# What each thing costs and how the cost grows: table and figure "Limits" of benchmarks/RESULTS.md, a quarter of an hour.
limits: setup
	mkdir -p out
	$(BIN)/python benchmarks/limits.py --figure docs/img/growth.svg | tee out/limits.md

# Recordings from elsewhere, the slow ones too: tests/foreign/README.md.
foreign: setup
	RIGCTL_FOREIGN=1 $(BIN)/pytest -n 2 --dist loadfile tests/foreign

# Tables in which nothing is hidden, 400 of each kind of noise: hours. Interrupted, give it again: what has been tried is not tried again.
false-alarms: setup
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.foreign.false_alarms --out out/false-alarms.jsonl

# Random tables written in other ways (order, words, names, units): the same must be found. Hours; can be interrupted as above. TABLES=40 for fewer.
metamorphic: setup
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.foreign.metamorphic --tables $(TABLES) --out out/metamorphic.jsonl

# Twenty recordings of each second world with runs, run_ids, mountings and columns written in other ways: a quarter of an hour.
metamorphic-bundles: setup
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.foreign.metamorphic_bundles --bundles 20 --out out/metamorphic-bundles.jsonl

# The linear stage's contract on every two readings of the Ensemble's manual at once: a minute.
dialects: setup
	RIGCTL_ALL_PAIRS=1 $(BIN)/pytest tests/drivers/test_linear_stage_contract.py

# Other people's drivers against the simulators, in an environment of their own: tests/clients/README.md, which names those
# that no index has (RIGCTL_ODEMIS=DIR and others). InstrumentKit asks for versions that no longer build.
CLIENTS := out/clients
clients:
	test -x $(CLIENTS)/bin/python || $(PYTHON) -m venv $(CLIENTS)
	$(CLIENTS)/bin/python -m pip install --quiet --disable-pip-version-check -e ".[clients]" pytest pytest-timeout hypothesis
	$(CLIENTS)/bin/python -m pip install --quiet --disable-pip-version-check future pyusb python-usbtmc python-vxi11 quantities ruamel.yaml
	$(CLIENTS)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps instrumentkit==0.6.0
	RIGCTL_CLIENTS=1 $(CLIENTS)/bin/python -m pytest -p no:cacheprovider tests/clients

# The flight model with an LK-G5000 and with the LK-G3001 in each reading of its manual, and the hidden effects: the same axes. Ten minutes.
laser-dialects: setup
	RIGCTL_ALL_PAIRS=1 OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/pytest tests/campaigns/test_laser_dialects.py

# Missions of ten calibrating sessions and two of the test, each with another instrument: tables 1 to 3, pulls. Two minutes of two cores for a hundred.
DRAWS ?= 100
missions: setup
	mkdir -p out
	rm -f out/missions.rig.sqlite*
	sed 's/^draws = .*/draws = $(DRAWS)/' campaigns/microscope-missions.toml > out/missions.toml
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/rigctl run out/missions.toml --rig campaigns/microscope-rig.toml --store out/missions.rig.sqlite --yes

# The same over sockets and pseudo-terminals, each reading of every instrument of the rig alone and the hardest together,
# with either kind of lasers; out/wire-dialects.md is the table of docs/hardware.md. A quarter of an hour on two cores.
wire-dialects: setup
	mkdir -p out
	rm -f out/wire-dialects.md
	RIGCTL_WIRE_DIALECTS=$(CURDIR)/out/wire-dialects.md OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n 2 tests/campaigns/test_dialects_over_the_wire.py

# A scripted operator at the console, by keys through a pseudo-terminal: every shipped campaign, the workbench's loop, faults. A quarter of an hour.
console-operator: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check pyte==0.8.2
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.console.operator

# The console's screens in docs/console.md: half a minute.
console-pictures: setup
	mkdir -p out
	rm -f out/one-axis.rig.sqlite*
	$(BIN)/rigctl run campaigns/one-axis.toml --store out/one-axis.rig.sqlite --yes
	$(BIN)/python -m tests.console.draw out/one-axis.rig.sqlite

# The figures of the pages, as `rigctl report` and `rigctl noise` draw them of what the pages tell to run: some minutes.
FIGURES := out/figures
docs-figures: setup console-pictures
	mkdir -p $(FIGURES)
	rm -f $(STORE)* out/hidden.rig.sqlite* out/unknown.rig.sqlite* out/microscope.rig.sqlite*
	$(BIN)/rigctl run campaigns/isa-flight-model.toml --store $(STORE) --yes
	$(BIN)/rigctl report $(STORE) --figures $(FIGURES)/isa
	cp $(FIGURES)/isa/fig12_X_pendulum.svg docs/img/null-search.svg
	cp $(FIGURES)/isa/fig15.svg docs/img/plane-x.svg
	cp $(FIGURES)/isa/budget.svg docs/img/budget.svg
	$(BIN)/rigctl run campaigns/hidden-effect.toml --store out/hidden.rig.sqlite --yes
	$(BIN)/rigctl model add out/hidden.rig.sqlite quadratic cable-hysteresis
	$(BIN)/rigctl report out/hidden.rig.sqlite --figures $(FIGURES)/hidden
	cp $(FIGURES)/hidden/residuals_approach.svg docs/img/hidden-approach.svg
	$(BIN)/rigctl import examples/unknown-effect --store out/unknown.rig.sqlite
	$(BIN)/rigctl model add out/unknown.rig.sqlite resonance roll-gravity
	$(BIN)/rigctl model add out/unknown.rig.sqlite pressure-gain --plugin examples/unknown-effect/my_effect.py
	$(BIN)/rigctl report out/unknown.rig.sqlite --plugin examples/unknown-effect/my_effect.py --figures $(FIGURES)/unknown
	cp $(FIGURES)/unknown/ladder.svg docs/img/unknown-ladder.svg
	cp $(FIGURES)/unknown/residuals_pressure_hpa.svg docs/img/unknown-pressure.svg
	$(BIN)/rigctl run campaigns/microscope.toml --store out/microscope.rig.sqlite --yes
	$(BIN)/rigctl noise out/microscope.rig.sqlite --run 1 --channel m1_y --above 0.3 --figures $(FIGURES)/noise
	cp $(FIGURES)/noise/density_run_1_m1_y.svg docs/img/noise-density.svg

# Every screen in every theme, at three sizes and without colour, in out/console-looks: to be looked at.
THEMES := rigctl-dark rigctl-light rigctl-contrast rigctl-night
console-looks: setup
	mkdir -p out
	test -f out/one-axis.rig.sqlite || $(BIN)/rigctl run campaigns/one-axis.toml --store out/one-axis.rig.sqlite --yes
	for size in 80x24 120x40 200x60; do \
	  for theme in $(THEMES); do $(BIN)/python -m tests.console.draw out/one-axis.rig.sqlite --size $$size --theme $$theme --out out/console-looks/$$theme-$$size || exit 1; done; \
	  NO_COLOR=1 $(BIN)/python -m tests.console.draw out/one-axis.rig.sqlite --size $$size --out out/console-looks/no-colour-$$size || exit 1; done

# The certificates that the README links, from campaigns on simulated instruments, a published table and a plug-in: two minutes, a browser.
CERTIFIED := isa-flight-model bias-rejection microscope
certificates: setup
	mkdir -p out docs/certificates
	rm -f $(CERTIFIED:%=out/%.rig.sqlite*) out/pontius.rig.sqlite* out/tumble-test.rig.sqlite*
	for name in $(CERTIFIED); do $(BIN)/rigctl run campaigns/$$name.toml --store out/$$name.rig.sqlite --yes \
	  && $(BIN)/rigctl certificate out/$$name.rig.sqlite --out docs/certificates/$$name.pdf || exit 1; done
	$(BIN)/rigctl import examples/pontius --store out/pontius.rig.sqlite
	$(BIN)/rigctl model add out/pontius.rig.sqlite 'power2[load_lb]'
	$(BIN)/rigctl certificate out/pontius.rig.sqlite --out docs/certificates/pontius.pdf
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --upgrade --target out/plugins ./examples/tumble-test
	PYTHONPATH=out/plugins $(BIN)/rigctl run examples/tumble-test/one-axis.toml --store out/tumble-test.rig.sqlite --yes
	PYTHONPATH=out/plugins $(BIN)/rigctl certificate out/tumble-test.rig.sqlite --out docs/certificates/tumble-test.pdf

# What the pages show beside what the program prints now; WRITE=--write renews the pages.
samples: setup
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/python -m tests.doc_samples docs/workbench.md docs/table.md $(WRITE)

# What is promised under faults, tried: docs/reliability.md. Half an hour on two cores.
reliability: setup
	$(RELIABILITY) --form short --out $(TRIALS)

# Some hours. Interrupted, give it again: seeds that have been tried are not tried again, and several runs add up.
reliability-full: setup
	$(RELIABILITY) --form full --out $(TRIALS)

# Fixed seeds, a minute.
reliability-ci: setup
	rm -rf $(TRIALS)-ci
	$(RELIABILITY) --form ci --out $(TRIALS)-ci

clean:
	rm -rf $(VENV) out .mypy_cache .ruff_cache .pytest_cache .hypothesis
