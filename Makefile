# `make demo` and `make test` need Python >= 3.11, cargo and a C linker, and fetch the rest into .venv and target.
# Other goals: soak, readme, pictures, words, proof, proof-docs, mistakes, accuracy, miri, licences, sbom, reproducible, wheel, format, docs, doc, clean.

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
MAKEFLAGS += --no-builtin-rules --no-print-directory

VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
WHEELS := $(VENV)/wheels
REPORT := out/demo.html
MANUAL := out/docs
CONCEALED ?=
ANSWERS ?= out/accuracy
# The set of cases of `make proof`: its folder, and the seed of the table in the manual.
OUT ?= out/proof
SEED ?= $(shell cat docs/proof/seed)
# The folder of `make mistakes`.
MISTAKES_OUT ?= out/mistakes
# How long `make soak` and `make fuzz` draw.
MINUTES ?= 10

SOURCES := Cargo.toml Cargo.lock pyproject.toml README.md \
  $(shell find crates python -type f -not -name '*.so' -not -name '*.pyc' -not -path '*/target/*')

.PHONY: help need demo built unit test lint rustfmt clippy ruff mypy rust python soak readme readme-check pictures words proof proof-docs mistakes accuracy miri wheel format docs doc clean hold fuzz fuzz-core licences sbom reproducible

help:
	@echo 'make demo      install into $(VENV) and diagnose the recording that ships with the package'
	@echo 'make test      lints, Rust tests, and Python tests against the installed wheel'
	@echo 'make soak      property tests with fresh seeds, for MINUTES=10; a failing case ends it'
	@echo 'make hold      hostile files, Ctrl-C, full disks, lost readers and kills: time, memory and faults'
	@echo 'make fuzz      damaged files to every reader, for MINUTES=10; a failing file is kept'
	@echo 'make proof     make 600 sealed cases, diagnose and score them; CASES= SEED= OUT= FAMILIES= SPLIT=scoring JOBS=2'
	@echo 'make mistakes  make logs with mistakes of wiring, sign, scale and time, and count which are told; MACHINES=3 SOUND=67 SEED= JOBS=2'
	@echo 'make accuracy  score the diagnosis on concealed cases, where CONCEALED=folder has them'
	@echo 'make fuzz-core the core under cargo-fuzz, MINUTES=10 for each target; needs a nightly toolchain and cargo-fuzz'
	@echo 'make licences  whether the licences of all that the wheel contains and needs are among those of deny.toml'
	@echo 'make sbom      bills of materials of the wheel (CycloneDX), in out/sbom; WHEEL=file takes one that is there'
	@echo 'make reproducible  build the wheel of the last commit twice and compare the files'
	@echo 'make miri      the unsafe code under Miri; needs a nightly toolchain with miri and rust-src'
	@echo 'make readme    put real output into README.md and the manual'
	@echo 'make pictures  make the example and the pictures of the manual'
	@echo 'make words     look for long sentences and banned words in messages, docstrings and pages'
	@echo 'make wheel     build the wheel only'
	@echo 'make format    rustfmt and ruff format'
	@echo 'make docs      the manual, with every example run'
	@echo 'make doc       the manual of the Rust crate'
	@echo 'make clean     remove $(VENV), target and out'

# One sentence for each tool that is missing, before anything is built.
need:
	@.ci/need

$(VENV)/pyvenv.cfg: | need
	@"$$(.ci/need python)" -m venv $(VENV)
	@$(PIP) install --upgrade pip

$(VENV)/.wheel: $(SOURCES) | need $(VENV)/pyvenv.cfg
	@echo 'Building the wheel; the first time takes some minutes ...'
	@rm -rf $(WHEELS)
	@$(PIP) wheel . --no-deps --wheel-dir $(WHEELS)
	@touch $@

$(VENV)/.installed: $(VENV)/.wheel
	@$(PIP) install --force-reinstall --no-deps $(WHEELS)/pmsm_rs-*.whl
	@$(PIP) install $(WHEELS)/pmsm_rs-*.whl
	@touch $@

$(VENV)/.test: $(VENV)/.installed
	@$(PIP) install "$$(echo $(WHEELS)/pmsm_rs-*.whl)[test,proof]"
	@touch $@

$(VENV)/.proof: $(VENV)/.installed
	@$(PIP) install "$$(echo $(WHEELS)/pmsm_rs-*.whl)[proof,peers]"
	@touch $@

$(VENV)/.docs: $(VENV)/.installed
	@$(PIP) install "$$(echo $(WHEELS)/pmsm_rs-*.whl)[docs]"
	@touch $@

wheel: $(VENV)/.wheel
	@ls $(WHEELS)/pmsm_rs-*.whl

demo: $(VENV)/.installed
	@mkdir -p $(dir $(REPORT))
	@$(BIN)/pmsm-rs demo --report $(REPORT)
	@echo 'Open it in a browser: file://$(CURDIR)/$(REPORT)'

# What takes the compiler longest, for `make -j2`; `test` then finds it done.
built: $(VENV)/.test $(VENV)/.docs unit

unit: | need
	cargo test --locked --no-run -p pmsm-core --lib

test: lint rust python readme-check docs

lint: rustfmt clippy ruff mypy

rustfmt: | need
	cargo fmt --all --check

clippy: | need
	cargo clippy --workspace --all-targets --locked --keep-going -- -D warnings

ruff: $(VENV)/.test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

mypy: $(VENV)/.test
	$(BIN)/mypy

# All but the tests inside the crate run on the library as the wheel holds it, which is compiled once for both: both crates are named, as
# the features of what they share are those of both.
rust: | need
	cargo test --locked --no-fail-fast -p pmsm-core --lib
	cargo test --locked --no-fail-fast -p pmsm-core -p pmsm-py --release --test '*'
	cargo test --locked --no-fail-fast -p pmsm-core -p pmsm-py --release --doc
	RUSTDOCFLAGS='-D warnings' cargo doc --locked --no-deps -p pmsm-core

# `--installed` refuses to test anything but the wheel.
python: $(VENV)/.test
	$(BIN)/pytest --installed -n auto --dist loadfile --no-loadscope-reorder

# `make test` draws the same cases in every run; this draws others, and says how to draw a failing one again.
soak: $(VENV)/.test
	$(BIN)/python .ci/soak.py --minutes $(MINUTES) --installed

# Prints figures. An end, a code, a traceback or a time that must not be fails it.
hold: $(VENV)/.test
	$(BIN)/python tests/hold.py

fuzz: $(VENV)/.test
	$(BIN)/python fuzz/readers.py --minutes $(MINUTES)

readme-check: $(VENV)/.test
	@$(BIN)/python docs/readme.py --check || \
	  { echo 'README.md does not show what the package prints; run make readme and read the difference.' >&2; exit 1; }

readme: $(VENV)/.installed
	$(BIN)/python docs/readme.py

# The example comes from the independent motor in proof/.
pictures: $(VENV)/.test
	$(BIN)/python docs/pictures.py

# Targets with what was found before; a crash is kept in fuzz/artifacts.
fuzz-core: | need
	@for target in $$(cargo +nightly fuzz list); do \
	  cargo +nightly fuzz run $$target -- -max_total_time=$$((60 * $(MINUTES))) -timeout=20 -rss_limit_mb=3000; done

licences: $(VENV)/.installed
	@$(BIN)/python .ci/licences.py

# What maturin writes into the wheel of the crates, and what is installed with the wheel.
sbom: $(if $(WHEEL),,$(VENV)/.wheel) | $(VENV)/pyvenv.cfg
	@$(PIP) install cyclonedx-bom
	@rm -rf out/sbom && mkdir -p out/sbom/wheel
	@"$$(.ci/need python)" -m venv out/sbom/clean
	@out/sbom/clean/bin/python -m pip --disable-pip-version-check --quiet install $(or $(WHEEL),$(WHEELS)/pmsm_rs-*.whl)
	@$(BIN)/python -m zipfile -e $(or $(WHEEL),$(WHEELS)/pmsm_rs-*.whl) out/sbom/wheel
	@cp out/sbom/wheel/*.dist-info/sboms/pmsm-py.cyclonedx.json out/sbom/pmsm-rs-rust.cdx.json
	@$(BIN)/cyclonedx-py environment --pyproject pyproject.toml --output-reproducible \
	  --of JSON -o out/sbom/pmsm-rs-python.cdx.json out/sbom/clean/bin/python
	@rm -rf out/sbom/wheel out/sbom/clean
	@ls out/sbom/*.json

reproducible: | need $(VENV)/pyvenv.cfg
	@.ci/reproducible $(CURDIR)/$(BIN)/pip

words: | need
	"$$(.ci/need python)" docs/words.py

# Interrupted, the same command goes on where it stopped.
proof: CASES ?= 600
proof: JOBS ?= 2
proof: SPLIT ?= scoring
proof: $(VENV)/.proof
	@$(BIN)/python -m proof --out $(OUT) --cases $(CASES) --seed $(SEED) --jobs $(JOBS) --split $(SPLIT) \
	  $(if $(FAMILIES),--families $(FAMILIES))

# SOUND=67 makes 201 logs without a mistake.
mistakes: MACHINES ?= 3
mistakes: SOUND ?= 67
mistakes: JOBS ?= 2
mistakes: $(VENV)/.proof
	@$(BIN)/python -m proof.mistakes --out $(MISTAKES_OUT) --machines $(MACHINES) --sound $(SOUND) --seed $(SEED) --jobs $(JOBS)

# Puts the results of the last `make proof` into the manual.
proof-docs:
	@if [ ! -f $(OUT)/table.md ]; then echo 'No results at $(OUT); run make proof first.'; exit 1; fi
	@mkdir -p docs/proof
	@cp $(OUT)/table.md $(OUT)/calibration.png $(OUT)/seed docs/proof/

accuracy: $(VENV)/.test
	@if [ ! -d '$(CONCEALED)/open' ]; then \
	  echo 'Name a folder with open/, sealed/, run.py and score.py by CONCEALED=...'; exit 1; fi
	@mkdir -p $(ANSWERS)
	$(BIN)/python $(CONCEALED)/run.py --answers $(ANSWERS) --tool $(BIN)/pmsm-rs $(if $(CASES),--only $(CASES))
	$(BIN)/python $(CONCEALED)/score.py --answers $(ANSWERS) --out $(ANSWERS).json

# The unsafe code. Miri knows AVX2, and of AVX-512 all but comparisons.
miri: | need
	RUSTFLAGS='-Ctarget-feature=+avx2,+fma' cargo +nightly miri test --locked -p pmsm-core --lib numerics::lanes::tests
	RUSTFLAGS='-Ctarget-feature=+avx512f,+avx512vl,+avx512bw,+avx512dq' \
	  cargo +nightly miri test --locked -p pmsm-core --lib numerics::lanes::tests::arithmetic

format:
	cargo fmt --all
	$(BIN)/ruff format .

# The manual, with every example run; a warning is an error.
docs: $(VENV)/.docs
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs $(MANUAL)
	@echo 'Open it in a browser: file://$(CURDIR)/$(MANUAL)/index.html'

doc:
	cargo doc --locked --no-deps -p pmsm-core

clean:
	rm -rf $(VENV) target out docs/generated docs/gallery docs/sg_execution_times.rst
