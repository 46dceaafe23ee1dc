# "make demo" and "make test" install all dependencies and need only Python 3.10 to 3.13 with venv.
# If a ROS distribution is sourced, its rclpy, messages and Python are used.

ifdef ROS_DISTRO
PYTHON ?= python3
VENV := .venv-$(ROS_DISTRO)
EXTRAS := [test,view,camera,fleet]
CORE_EXTRAS :=
else
SUPPORTED := import ensurepip, sys, venv; sys.exit(not (3, 10) <= sys.version_info < (3, 14))
VENV := .venv
# That of the environment comes first: what was installed once needs no other.
PYTHON ?= $(firstword $(shell for python in $(VENV)/bin/python python3 python3.13 python3.12 \
	python3.11 python3.10; do \
	"$$python" -c '$(SUPPORTED)' 2> /dev/null && echo "$$python"; done; true))
EXTRAS := [ros,test,lint,view,camera,fleet]
CORE_EXTRAS := [ros]
# Number of packages with these extras, for the share of the installation that is done.
PACKAGES := 173
CORE_PACKAGES := 100
endif
BIN = $(VENV)/bin
PIP = $(BIN)/python -m pip install --disable-pip-version-check --progress-bar off
READY := $(VENV)/ready
# What "make demo" needs: without viewer, camera and tests.
CORE := $(VENV)/ready-core
DEMO_NEEDS := $(if $(or $(VIEW),$(CAMERA),$(wildcard $(READY))),$(READY),$(CORE))
LOG = $(VENV)/install.log

# Each package is collected, then installed; where $(PACKAGES) is not known, there is no share.
INSTALLED = ls -d $(VENV)/lib/*/site-packages/*.dist-info 2> /dev/null | wc -l
SHARE = $(if $(PACKAGES),$$(share=$$(( ($$(grep -c -e '^Collecting ' -e '^Processing ' $(LOG)) + \
	$$present + $$($(INSTALLED))) * 50 / $(PACKAGES) )); echo "$$((share < 99 ? share : 99)) %"))

# $(new_environment) makes $(VENV), or refuses the Python before anything is written. What another
# Python has left there is removed.
define new_environment
@$(or $(PYTHON),python3) -c '$(SUPPORTED)' 2> /dev/null || { echo "$(or $(PYTHON),python3) is" \
	"$$($(or $(PYTHON),python3) --version 2>&1 | head -n 1), expected" \
	'Python 3.10 to 3.13 with venv: install one (on Debian: python3-venv) or name it: make PYTHON=...' >&2; exit 1; }
@echo 'Installing into $(VENV), with $(PYTHON); log: $(LOG)'
@$(PYTHON) -m venv $(if $(filter-out $(BIN)/python,$(PYTHON)),--clear) $(VENV)
endef

# What pip does now, without its warnings.
LATEST = grep -v -i '^ *\(warning\|deprecation\)' $(LOG) | tail -n 1

# $(call step,TEXT,COMMAND) prints what is done, every five seconds the share and the last line of
# its log, and how long it took; the end of the log if it failed.
define step
@echo '$(1)'; begin=$$(date +%s); present=$$($(INSTALLED)); : > $(LOG); \
( while sleep 5 > /dev/null 2>&1 && kill -0 $$$$ 2> /dev/null; do printf '  %3d s  %4s  %.74s\n' \
	$$(($$(date +%s) - begin)) "$(SHARE)" "$$($(LATEST))"; done ) & ticker=$$!; \
$(2) >> $(LOG) 2>&1; status=$$?; kill $$ticker; \
if [ $$status -ne 0 ]; then tail -n 30 $(LOG) >&2; exit $$status; fi; \
echo "  done in $$(($$(date +%s) - begin)) s"
endef

# Set inside a Python process with the rclpy wheels; must not be inherited by another one.
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE
# Tests start some hundreds of processes: none shall compile the package again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help setup demo demo-loaded test pytest test-jazzy lint check current mutants fuzz soak \
	stop-times bench bench-slip bench-friction bench-control config docs screenshots site clean
help:
	@echo 'make demo            run the simulated robot and all nodes; results in demo_output/'
	@echo 'make demo VIEW=1     the same, live in the viewer'
	@echo 'make demo CAMERA=1   the same, with a simulated camera above the floor'
	@echo 'make demo-loaded     the same, ten times on a busy machine; RUNS=N for N times'
	@echo 'make test            check style and types, run the tests'
	@echo 'make test-jazzy      run the tests of the nodes, and the linters of ROS, with ROS 2 Jazzy'
	@echo 'make lint            check style and types only'
	@echo 'make check           make test with coverage, generated files, documentation site, fuzz'
	@echo '                     test, stop times, quick benchmarks'
	@echo 'make stop-times      measure the stop time of the wheels for each hazard; RUNS=N'
	@echo 'make mutants         mutation test of the safety path; SAMPLE=N for N mutants, SEED=S'
	@echo '                     for others, ROOM=bags for those of a folder of smart_tire'
	@echo 'make fuzz            give damaged bytes to all readers of bytes, and damaged messages'
	@echo '                     to the nodes; SECONDS=N, SEED=S'
	@echo 'make soak            drive for an hour with random faults; MINUTES=N, SEED=S'
	@echo 'make bench           measure CPU load, latency, largest load, start, calibration'
	@echo 'make bench-slip      measure slip and localization; results in bench_output/slip/'
	@echo 'make bench-friction  measure friction; results in bench_output/friction/'
	@echo 'make bench-control   measure wheel and path control; results in bench_output/control/'
	@echo 'make config          regenerate config/*.yaml and urdf/'
	@echo 'make docs            regenerate docs/architecture.svg and docs/topics.md'
	@echo 'make screenshots     take the pictures of the viewer in docs/images/'
	@echo 'make site            build the documentation site in site_output/html/'
	@echo 'make clean           remove installed and built files'

setup: $(READY)

# An editable installation compiles in the source tree: again after each change of COMPILED.
COMPILED := $(shell grep -rl '^COMPILED: bool = cython.compiled' smart_tire --include='*.py')
REMOVE_EXTENSIONS := find smart_tire -name '*.so' -delete

$(CORE): EXTRAS := $(CORE_EXTRAS)
$(CORE): PACKAGES := $(CORE_PACKAGES)
$(READY) $(CORE): constraints.txt requirements.txt setup.py setup.cfg pyproject.toml $(COMPILED) $(shell find smart_tire -name '*.pxd')
	@$(REMOVE_EXTENSIONS)
ifdef ROS_DISTRO
	@echo 'Installing into $(VENV), on top of ROS $(ROS_DISTRO); log: $(LOG)'
	@$(PYTHON) -m venv --system-site-packages $(VENV)
	$(call step,1/2 packages without rosdep key,$(PIP) -r requirements.txt)
	$(call step,2/2 smart_tire and its tools,$(PIP) --editable '.$(EXTRAS)')
else
	$(new_environment)
	$(call step,1/2 setuptools,$(PIP) --constraint constraints.txt cython setuptools)
	$(call step,2/2 smart_tire with rclpy and libraries ($(if $(filter $@,$(CORE)),0.7,1.9) GB): \
		takes a few minutes,$(PIP) \
		--constraint constraints.txt --no-build-isolation --use-pep517 \
		--editable '.$(EXTRAS)')
endif
	@touch $@ $(CORE)

demo: $(DEMO_NEEDS)
	$(BIN)/smart_tire demo --force $(if $(VIEW),--view) $(if $(CAMERA),--camera)

bench: $(READY)
	@failed=; run() { echo "$(BIN)/python -m benchmarks.$$*"; \
		$(BIN)/python -m "benchmarks.$$@" || failed="$$failed $$1"; }; \
	run load; run offline; run capacity; run start; \
	run calibration --seeds 20 --first-seed 201 --force; \
	test -z "$$failed" || { echo "failed:$$failed" >&2; exit 1; }

bench-slip: $(READY)
	$(BIN)/python -m benchmarks.slip --force

bench-friction: $(READY)
	$(BIN)/python -m benchmarks.friction --force

bench-control: $(READY)
	$(BIN)/python -m benchmarks.control --first-seed 41 --force

# Types and the drawing depend on the versions of numpy and matplotlib, which are different in a ROS
# distribution and on Python 3.10.
ifdef ROS_DISTRO
NEWEST := false
else
NEWEST := $(BIN)/python -c 'import sys; sys.exit(sys.version_info < (3, 11))'
endif

# Style and types are checked with the pinned tools only.
lint: $(READY)
ifndef ROS_DISTRO
	$(BIN)/ruff check --quiet .
	@if $(NEWEST); then echo $(BIN)/mypy --no-error-summary; $(BIN)/mypy --no-error-summary; \
	else echo 'types are not checked on Python 3.10'; fi
endif

# Style and types are checked while the tests run. Three workers, for two cores: tests of processes
# mostly wait; test/conftest.py describes the order.
test: $(READY)
	+@$(MAKE) --no-print-directory --jobs=2 lint pytest

pytest: $(READY)
	$(BIN)/python -m pytest -n 3 --durations=25 $(SELECTION)

# What depends on rclpy, and the linters, with the wheels of ROS 2 Jazzy: in an environment of their
# own, because constraints.txt pins those of Kilted.
TESTS_ON_JAZZY := test/nodes test/safety/test_nodes.py test/cli/test_record.py test/test_ament_lint.py
ifdef ROS_DISTRO
test-jazzy:
	@echo 'make test-jazzy needs a shell without a sourced ROS distribution' >&2; exit 1
else
JAZZY := .venv-jazzy-wheels
test-jazzy $(JAZZY)/ready: VENV := $(JAZZY)
$(JAZZY)/ready: PACKAGES := 121
$(JAZZY)/ready: requirements-jazzy.txt constraints.txt
	$(new_environment)
	@grep -v '^ros-\|^setuptools' constraints.txt > $(VENV)/constraints.txt
	$(call step,1/1 rclpy of ROS 2 Jazzy with libraries and linters,{ $(PIP) \
		--requirement requirements-jazzy.txt --constraint $(VENV)/constraints.txt || \
		{ echo 'cannot install ROS 2 Jazzy: is the registry of packages reachable?'; false; }; })
	@touch $@

test-jazzy: $(JAZZY)/ready
	$(BIN)/python -m pytest -n 3 --durations=10 $(TESTS_ON_JAZZY)
endif

# Those "long" tests that drive in real time run alone. The results of the benchmarks are in
# bench_output/check/.
ALONE := long and (processes or safety)
check: export SELECTION := -m 'not ($(ALONE))' --cov --cov-report=term --cov-fail-under=92
check: $(VENV)/ready-evo test current site
	$(BIN)/python -m pytest -m '$(ALONE)'
	$(BIN)/python test/fuzz.py --seconds 60
	$(BIN)/python test/safety/stop_times.py --runs 1
	$(BIN)/python -m benchmarks.slip --quick --force --out bench_output/check/slip
	$(BIN)/python -m benchmarks.friction --quick --force --out bench_output/check/friction
	$(BIN)/python -m benchmarks.control --quick --force --out bench_output/check/control

# A test compares exported paths with it; without it the test is skipped.
$(VENV)/ready-evo: $(READY)
	@echo 'Installing evo into $(VENV)'
	@$(PIP) $(if $(ROS_DISTRO),,--constraint constraints.txt) 'evo; python_version >= "3.11"'
	@touch $@

# Regenerate files derived from the source; fail if one of them was outdated.
GENERATED := config/*.yaml config/security/policy.xml urdf/smart_tire.urdf docs/topics.md \
	smart_tire_msgs/msg/*.msg
current: $(READY)
	@files="$(GENERATED) $$($(NEWEST) && echo docs/architecture.svg)"; \
	before=$$(cat $$files | cksum); \
	$(MAKE) --no-print-directory config docs && \
	if [ "$$before" != "$$(cat $$files | cksum)" ]; \
	then echo "$$files: regenerated because they were outdated" >&2; exit 1; fi

# Real processes and emulated motor boards with faults; see docs/safety.md.
stop-times: $(READY)
	$(BIN)/python test/safety/stop_times.py $(if $(RUNS),--runs $(RUNS))

# 100 mutants of the safety path, or of a folder; see test/mutation.py.
mutants: $(READY)
	$(BIN)/python test/mutation.py $(if $(SAMPLE),--sample $(SAMPLE)) $(if $(SEED),--seed $(SEED)) \
		$(if $(ROOM),--room $(ROOM))

# Damaged bytes for each reader of bytes from outside, messages for nodes; see test/fuzz.py.
fuzz: $(READY)
	$(BIN)/python test/fuzz.py $(if $(SECONDS),--seconds $(SECONDS)) $(if $(SEED),--seed $(SEED))

# Hours of driving with random faults; see test/soak.py.
soak: $(READY)
	$(BIN)/python test/soak.py $(if $(MINUTES),--minutes $(MINUTES)) $(if $(SEED),--seed $(SEED))

# With two busy processes per core; see test/loaded_demo.py.
demo-loaded: $(READY)
	$(BIN)/python test/loaded_demo.py $(if $(RUNS),--runs $(RUNS))

config: $(READY)
	$(BIN)/python docs/config_files.py config
	$(BIN)/python docs/rosbag2_qos.py config/rosbag2_qos.yaml
	$(BIN)/smart_tire policy > config/security/policy.xml
	$(BIN)/python docs/simulated_film.py config/calibration/simulated_film.yaml
	$(BIN)/python -m smart_tire.parameters.urdf_writer urdf/smart_tire.urdf

docs: $(READY)
	$(BIN)/python docs/draw_architecture.py
	$(BIN)/python docs/topics_page.py
	$(BIN)/python docs/theory_page.py

# Pictures of the viewer from the bag of a demo; requires playwright, pillow and Chromium.
screenshots: $(READY)
	$(BIN)/python docs/take_screenshots.py demo_output

# Its libraries are installed when first needed. Notebooks run in a kernel of this environment.
$(VENV)/ready-site: $(READY)
	@echo 'Installing the libraries of the site into $(VENV)'
ifdef ROS_DISTRO
	@$(PIP) --editable '.[docs]'
else
	@$(PIP) --constraint constraints.txt --no-build-isolation --use-pep517 --editable '.[docs]'
endif
	@touch $@

site: $(VENV)/ready-site
	$(BIN)/python -m sphinx -W --keep-going -q -E -b html docs site_output/html

clean:
	rm -rf .venv .venv-* build install log *.egg-info .coverage* .hypothesis .mypy_cache \
		.pytest_cache .ruff_cache site_output docs/examples docs/changelog.rst \
		docs/contributing.md
	$(REMOVE_EXTENSIONS)
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
