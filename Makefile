# `make help` lists the targets. Targets that need the environment create it first.

PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
# `variants` of params.yaml, read where a target needs it, from the last: E trains longest, and
# started first it leaves no core idle at the end.
VARIANTS = $(or $(shell $(BIN)/python -c 'import yaml; print(*yaml.safe_load(open("params.yaml"))["variants"][::-1])'),$(error params.yaml: `variants` must be a list of names))
# On a CPU, narrow networks train faster in parallel, each on a share of the cores, than one by one
# on all cores; a GPU trains one at a time.
JOBS ?= $(shell if nvidia-smi -L >/dev/null 2>&1; then echo 1; else n=$$(nproc); v=$(words $(VARIANTS)); echo $$((n < v ? n : v)); fi)
THREADS ?= $(shell n=$$(nproc); echo $$((n > $(JOBS) ? n / $(JOBS) : 1)))
export PATH := $(CURDIR)/$(BIN):$(PATH)
# Memory in huge pages, in which networks are faster (docs/training.md); `make env` sets this in
# .venv/bin/activate, too.
export GLIBC_TUNABLES ?= glibc.malloc.hugetlb=1

.DEFAULT_GOAL := help
.PHONY: help env repro report test lint format bench bench-inference bench-soak bench-render bench-train bench-pages ui figures large-frames film architecture results clean

help:  ## list the targets
	@grep -hE '^[a-z%-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 14

env: $(READY)  ## create .venv with pinned dependencies, after checking system libraries

$(READY): pyproject.toml constraints.txt
	@command -v $(PYTHON) >/dev/null || { echo "error: no $(PYTHON): install Python 3.11 with its venv module, or set PYTHON=/path/to/python3.11"; exit 1; }
	$(PYTHON) tools/check_system.py
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --upgrade pip
	$(BIN)/pip install --quiet -e '.[dev]' -c constraints.txt
	echo 'export GLIBC_TUNABLES="$${GLIBC_TUNABLES:-glibc.malloc.hugetlb=1}"' >> $(BIN)/activate
	touch $@

repro: $(READY)  ## run the whole pipeline (params.yaml: profile), then print the ablation
	dvc repro split real_images detector
	$(MAKE) --jobs=$(JOBS) $(addprefix variant-,$(VARIANTS))
	dvc repro
	@cat reports/ablation.md
	@echo
	@echo "report:   $(CURDIR)/reports/ablation.html"
	@echo "tracking: $(CURDIR)/mlflow.db (make ui)"

report: $(READY)  ## update the report, one stage at a time
	dvc repro report
	@echo "report: $(CURDIR)/reports/ablation.html"

# Leaves out `evaluate`, which also measures speed and must run alone. A single variant has as many
# threads as in `repro`: with other numbers of threads, weights differ by rounding.
variant-%: $(READY)  ## train one of `variants` on existing data, as in `make variant-d`
	OMP_NUM_THREADS=$(THREADS) dvc --wait-for-lock repro --single-item $(addsuffix @$*,train export evaluate_real)

# A file of tests stays in one process, whose costly fixtures its tests share; one thread each, for
# the processes fill the cores, one more because tests wait for other processes. Files stay in their
# order, in which the longest does not come last (tests/conftest.py).
test: $(READY)  ## run all tests, a process per core and one more
	OMP_NUM_THREADS=1 pytest --numprocesses $$(($$(nproc) + 1)) --dist loadfile --no-loadscope-reorder

lint: $(READY)  ## check style, format and types
	ruff check .
	ruff format --check .
	mypy

format: $(READY)  ## fix style and format
	ruff check --fix .
	ruff format .

# Results of benchmarks go to reports/benchmarks; with BENCHMARKS=benchmarks/results, into the
# project's own record.
bench: $(READY)  ## measure images/s of the models from `make repro`
	python -m benchmarks.prediction

bench-inference: $(READY)  ## measure speed and memory from a large frame to poses, on an idle machine
	python -m benchmarks.inference
	python -m benchmarks.backends

bench-soak: $(READY)  ## measure the memory of prediction over 20,000 frames
	python -m benchmarks.soak

bench-render: $(READY)  ## measure images/s, quality and memory of the renderer, on an idle machine
	python -m benchmarks.render

bench-train: $(READY)  ## measure images/s of the network's step alone and of whole trainings
	python -m benchmarks.training

bench-pages: $(READY)  ## measure the gain from memory in huge pages, on an idle machine
	OMP_NUM_THREADS=1 python -m benchmarks.page_size

ui: $(READY)  ## serve mlflow.db, and print the addresses of its tables (a server in tracking.uri has its own pages)
	@python -m shaftpose.tracking
	MLFLOW_DISABLE_TELEMETRY=true MLFLOW_SERVER_ENABLE_JOB_EXECUTION=false \
	mlflow ui --host 127.0.0.1 --port 5000 --workers 1 --backend-store-uri sqlite:///mlflow.db

figures: $(READY)  ## draw the pictures of README and docs from the data and reports of `make repro`
	shaftpose show backgrounds data/backgrounds --out docs/images/backgrounds.jpg --count 18 --columns 6
	shaftpose show dataset data/render/images --out docs/images/renders.jpg --count 12 --columns 4
	shaftpose show dataset data/render/occluded --out docs/images/occluded.jpg --count 4 --columns 4
	python -m studies.preset_picture laparoscopy docs/images/laparoscopy_preset.jpg
	install -m 644 reports/e/figures/predictions.jpg docs/images/predictions.jpg
	install -m 644 reports/e/figures/worst_predictions.jpg docs/images/worst_predictions.jpg
	install -m 644 reports/e/figures/errors_over_bounds.png docs/images/over_bounds.png
	install -m 644 reports/e/silhouettes.jpg docs/images/silhouettes.jpg
	install -m 644 reports/data_card/figures/distributions.png docs/images/distributions.png
	install -m 644 reports/figures/binned_errors.png docs/images/binned_errors.png
	python -m studies.palette_pictures docs/images/*.png

large-frames: $(READY)  ## render large frames on data/backgrounds, and show in docs what they give the fit
	python -m studies.large_frames

film: $(READY)  ## render moving shafts, track them, and show it in docs
	rm -rf data/film
	python -m studies.moving_shafts data/film --frames 100
	shaftpose predict data/film/film.mp4 --view-deg 63.1 --diameter-mm 3 --out data/film/alone
	shaftpose predict data/film/film.mp4 --view-deg 63.1 --diameter-mm 3 --out data/film/tracked --draw --track
	python -m studies.film_results data/film

architecture: $(READY)  ## write the tables of docs/architecture.md
	python -m studies.architecture_tables

results: $(READY)  ## write the results in README and docs from what Git holds
	python -m studies.scaling_tables
	python -m studies.write_results_page

clean:  ## remove data/scratch, from which interrupted renders and trainings resume
	rm -rf data/scratch
