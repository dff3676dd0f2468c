# Everything runs in .venv, installed at the versions that constraints.txt pins.

PYTHON ?= python3
BIN := .venv/bin
DATA := recordings/data
# A command takes a third longer where Python compiles the package each time; tests start hundreds.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: docs tutorials gallery demo test test-all test-fast snapshots mutants fuzz-fmu benchmark anatomy benchmark-parts benchmark-scale benchmark-commands benchmark-command performance digests benchmark-peers verify-elsewhere benchmark-studies soak release urdfs real-fmus figures viewers rerun-picture report-pictures reference paper lint lock clean

demo: .venv/.installed  ## run the paper's example and say how to open the recording
	@$(BIN)/nrs run scenarios/paper_first_order.toml -o $(DATA)/demo.mcap --force
	@echo
	@$(BIN)/python -m docs.demo $(DATA)/demo.mcap

test: .venv/.tested  ## install what the tests need and pass them, one process more than processors, up to eight
	$(BIN)/pytest --numprocesses auto --maxprocesses 8 --dist worksteal $(ARGS)

test-all: .venv/.tested  ## the same with all random cases, of which make test tries a part
	NRS_TESTS=all $(BIN)/pytest --numprocesses auto --maxprocesses 8 --dist worksteal $(ARGS)

test-fast: .venv/.tested  ## the tests that take less than half a second each: all in a minute
	$(BIN)/pytest --numprocesses auto --maxprocesses 8 --dist worksteal -m "not slow" $(ARGS)

snapshots: .venv/.tested  ## write what the commands print into tests/snapshots; see git diff
	$(BIN)/pytest --quiet --snapshots tests/orchestrator/test_analysis.py tests/orchestrator/test_printed.py

mutants: .venv/.tested  ## change the core in a sample of places; the tests are to find 95 %
	$(BIN)/python -m tests.mutation $(ARGS)

fuzz-fmu: .venv/.tested  ## random FMI calls, allowed and forbidden, on bundled models under sanitizers
	$(BIN)/python -m tests.plant_fmu.call_fuzzing $(ARGS)

benchmark: .venv/.installed  ## robot-intervals per second, recorded and by bare loops, in one table
	$(BIN)/python -m benchmarks.throughput $(ARGS)

anatomy: .venv/.installed  ## where each microsecond of a robot-interval goes
	$(BIN)/python -m benchmarks.anatomy $(ARGS)

benchmark-parts: .venv/.installed  ## FMUs in a process of their own; recordings beside other libraries
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[benchmark]'
	$(BIN)/python -m benchmarks.isolation
	$(BIN)/python -m benchmarks.recordings

benchmark-scale: .venv/.installed  ## what a robot-interval costs of 1,000 to 100,000 robots: time, memory, bytes
	$(BIN)/python -m benchmarks.scale $(ARGS)

benchmark-commands: .venv/.installed  ## time and memory that commands take of a recording of four million messages
	$(BIN)/python -m benchmarks.commands $(ARGS)

benchmark-command: .venv/.installed  ## the whole nrs run of the paper's example beside a script with FMPy; what commands load
	$(BIN)/python -m benchmarks.command $(ARGS)

performance: benchmark anatomy benchmark-command benchmark-peers digests  ## on a quiet machine: all of docs/performance.md, and the floors that tests hold
	$(BIN)/python -m benchmarks.ratios --keep

digests: .venv/.tested  ## the digest of the paper's example by threads, workers, compilers, processors' features
	$(BIN)/python -m benchmarks.digests

benchmark-peers: .venv/.installed .venv-peers/.created  ## other engines on the same FMU, in .venv-peers
	$(BIN)/python -m benchmarks.peers.beside .venv-peers/bin/python $(ARGS)

verify-elsewhere: .venv/.tested .venv-peers/.created  ## three other engines run exported systems, and come to the very same numbers
	$(BIN)/python -m tests.elsewhere .venv-peers/bin/python

benchmark-studies: .venv/.tested  ## what a study costs beyond its runs, and what it survives: half an hour
	$(BIN)/python -m benchmarks.studies $(ARGS)

soak: .venv/.tested  ## ten million messages over workers that are killed; a thousand runs; checkpoints' cost; 320 designs
	$(BIN)/python -m benchmarks.checkpoints
	$(BIN)/python -m benchmarks.repeated
	$(BIN)/python -m benchmarks.soak
	$(BIN)/python -m tests.designs

release: .venv/.tested  ## build wheel and sdist into dist, and use them in a clean environment of each Python on PATH, or of PYTHONS
	$(BIN)/python -m tests.release $(PYTHONS)

urdfs: .venv/.tested  ## build the robots of packages of URDFs, beside Pinocchio: docs/robots.md, in ten minutes
	$(BIN)/pip download --quiet --disable-pip-version-check --no-deps --dest $(DATA)/urdfs example-robot-data==6.0.0 icub-models==3.2.0 airo-models==0.0.12
	$(BIN)/python -m tests.urdfs $(DATA)/urdfs > docs/robots.md

real-fmus: .venv/.tested  ## check FMUs that packages bring, as robots: docs/real_fmus.md
	$(BIN)/pip download --quiet --disable-pip-version-check --no-deps --dest $(DATA)/fmus crane-fmu==0.2.0 gemseo-fmu==3.1.1
	$(BIN)/python -m tests.fmus $(DATA)/fmus > docs/real_fmus.md

figures: .venv/.installed  ## draw the documents' figures
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[figures]'
	$(BIN)/nrs run scenarios/paper_first_order.toml -o $(DATA)/figures.mcap --force
	$(BIN)/python -m docs.figures $(DATA)/figures.mcap docs/paper_first_order.png

docs: .venv/.tested  ## build the documentation site, docs/site/index.html
	$(BIN)/python -m sphinx -q -W --keep-going -d docs/site/.doctrees docs docs/site
	@echo docs/site/index.html

gallery: .venv/.tested  ## run every scenario and draw it into docs/gallery
	$(BIN)/python -m docs.gallery docs

tutorials: .venv/.tested  ## run the tutorials and write what they show, with their pictures
	$(BIN)/python -m docs.pages README.md docs/results.md docs/studies.md docs/tutorials/*.md

viewers: .venv/.tested  ## other tools' readers of recordings, with those too large for make test: Rerun, npm's @mcap/core
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[viewers]'
	if command -v npm; then npm install --silent --no-audit --no-fund --prefix $(DATA)/npm @mcap/core@2.2.2 fzstd@0.1.1; fi
	NODE_PATH=$(CURDIR)/$(DATA)/npm/node_modules $(BIN)/pytest -rs tests/recordings/test_viewers.py tests/recordings/test_ros2.py tests/recordings/test_foxglove.py tests/test_tools_document.py

rerun-picture: .venv/.tested  ## what Rerun shows of the paper's example, through Chromium
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[viewers]'
	$(BIN)/nrs run scenarios/paper_first_order.toml -o $(DATA)/figures.mcap --force
	rm -f $(DATA)/bag.mcap
	$(BIN)/nrs convert $(DATA)/figures.mcap --to ros2 -o $(DATA)/bag.mcap
	$(BIN)/python -m docs.rerun_picture $(DATA)/bag.mcap docs/rerun.png

report-pictures: .venv/.tested  ## pages of reports, of six robots and of a hundred, through Chromium
	$(BIN)/nrs run scenarios/paper_first_order.toml -o $(DATA)/figures.mcap --force
	$(BIN)/nrs run scenarios/ring_100.toml -o $(DATA)/ring_100.mcap --force
	$(BIN)/nrs report $(DATA)/figures.mcap -o $(DATA)/figures.html
	$(BIN)/nrs report $(DATA)/ring_100.mcap -o $(DATA)/ring_100.html
	$(BIN)/python -m docs.report_picture $(DATA)/figures.html docs/report.png light
	$(BIN)/python -m docs.report_picture $(DATA)/figures.html docs/report_theory.png light figure-envelopes
	$(BIN)/python -m docs.report_picture $(DATA)/ring_100.html docs/report_100.png dark

reference: .venv/.installed  ## write docs/scenario.md and docs/cli.md from the code
	$(BIN)/python -m docs.reference docs

paper: .venv/.installed  ## run the paper's cases and studies; its figures and numbers beside ours in docs/paper
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[analysis,figures]'
	$(BIN)/python -m docs.paper_tables $(DATA) docs/paper
	$(BIN)/python -m docs.comparison $(DATA) docs/paper
	$(BIN)/python -m docs.paper_studies $(DATA) docs/paper

lint: .venv/.tested  ## format and lint
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

lock: .venv/.tested  ## write the versions of this environment into constraints.txt
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[test,figures]'
	$(BIN)/pip freeze --exclude-editable | LC_ALL=C sort -f > constraints.txt

clean:
	rm -rf .venv .venv-peers $(DATA)

.venv-peers/.created:
	$(PYTHON) -m venv .venv-peers
	@touch $@

.venv/.created:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed; choose one with make PYTHON=python3.11")'
	$(PYTHON) -m venv .venv
	@touch $@

.venv/.installed: .venv/.created pyproject.toml constraints.txt
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[report]'
	@touch $@

.venv/.tested: .venv/.installed pyproject.toml constraints.txt
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[test]'
	@touch $@
