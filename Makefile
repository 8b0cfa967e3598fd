# Every target makes what it needs: Debian packages where they are missing, Python environments, the
# program. A second run finds it all there.
.DEFAULT_GOAL := demo
.PHONY: demo test fuzz soak large coverage check bench build mpi setup share install dist deb wheel addon clean

export CUMULO := $(CURDIR)/target/release/cumulo
export PYTHONDONTWRITEBYTECODE := 1
# Where rustup puts cargo, for shells that have not been told yet.
export PATH := $(PATH):$(HOME)/.cargo/bin
CARGO_TARGET_DIR := $(CURDIR)/target
export CARGO_TARGET_DIR
# What `cumulo --version` states, and the time of what is packed: the commit, and its date or SOURCE_DATE_EPOCH. A source
# archive has no commit.
ifneq ($(wildcard .git),)
SOURCE_DATE_EPOCH ?= $(shell git show --no-patch --format=%ct 2>/dev/null)
CUMULO_COMMIT ?= $(shell git describe --always --dirty --abbrev=12 --exclude '*' 2>/dev/null), $(shell \
	date --utc --date=@$(SOURCE_DATE_EPOCH) +%F)
endif
CUMULO_COMMIT := $(CUMULO_COMMIT)
export CUMULO_COMMIT

# `make demo BLENDER=1` reconstructs from pictures that Cycles rendered.
BLENDER ?=
# Environments of the other programs, see python/peers/README.md.
PEERS ?=

setup: ## everything that the other targets may need
	python/setup.sh

build: ## the program, and the native module of the Python package beside its sources
	python/setup.sh build
	cargo build --release --locked
	install -m 755 target/release/lib_native.so python/cumulo/_native.abi3.so

mpi: ## the program for clusters, target/release/cumulo-mpi
	python/setup.sh build mpi
	cargo build --release --locked --workspace

demo: build
ifneq ($(filter-out 0,$(BLENDER)),)
	python/setup.sh bpy
	.venvs/bpy/bin/python python/demo.py --blender
else
	/usr/bin/python3 python/demo.py
endif

# A file's tests share what they render, so that they stay with one process.
PARALLEL := --numprocesses 2 --dist loadfile

test: setup build mpi
	cargo test --release --locked --workspace
	.venvs/bpy/bin/python -m pytest $(PARALLEL) python/tests --ignore python/tests/usd --ignore python/tests/mitsuba --ignore python/tests/imaging --ignore python/tests/torch
	.venvs/usd/bin/python -m pytest python/tests/usd
	.venvs/mitsuba/bin/python -m pytest python/tests/mitsuba
	.venvs/imaging/bin/python -m pytest $(PARALLEL) python/tests/imaging
	.venvs/torch/bin/python -m pytest $(PARALLEL) python/tests/torch

# `make fuzz FUZZ_INPUTS=500 FUZZ_SEED=7 KILLS=10` runs fewer, or others.
FUZZ_INPUTS ?= 10000
KILLS ?= 200

fuzz: ## ten thousand damaged inputs through every command that reads them; every command that writes killed two hundred times
	python/setup.sh build
	FUZZ_INPUTS=$(FUZZ_INPUTS) cargo test --release --locked --test process fuzz:: -- --nocapture
	CUMULO_KILLS=$(KILLS) cargo test --release --locked --test process killed:: -- --nocapture

SOAK_SECONDS ?= 600

soak: ## random hard scenes, path-traced for ten minutes
	python/setup.sh build
	SOAK_SECONDS=$(SOAK_SECONDS) cargo test --release --locked --test process soak:: -- --nocapture

large: ## a sparse volume of 1024³ voxels rendered and reconstructed within 2 GiB, in some minutes
	python/setup.sh build
	CUMULO_LARGE=1 cargo test --release --locked --test process scratch:: -- --nocapture

SEEDS ?= 1000

coverage: ## stated errors of path-traced pictures against the truth, over a thousand seeds of six scenes
	python/setup.sh build
	COVERAGE_SEEDS=$(SEEDS) cargo test --release --locked --test kernels accuracy:: -- --nocapture

check: ## what is worth seeing before each commit; under three minutes once built
	python/setup.sh build mpi
	cargo fmt --all --check
	cargo clippy --release --locked --workspace --all-targets -- -D warnings
	cargo test --release --locked --workspace --lib --bins

bench: build ## our figures against the goals, and tests/benches/RESULTS.md; PEERS="PEERS_ENV RTK_ENV" runs the peers too
	python/setup.sh bench
	/usr/bin/python3 python/bench.py --write $(if $(PEERS),--peers $(PEERS))

# `make install PREFIX=$HOME/.local` needs no root; DESTDIR serves packagers.
PREFIX ?= /usr/local

# Manual pages and the scripts by which shells complete, made by the program itself.
SHARE := target/share

share:
	@test -x $(CUMULO) || { echo "$(CUMULO) is missing: run 'make build' first" >&2; exit 1; }
	rm -rf $(SHARE)
	mkdir -p $(SHARE)/completions
	$(CUMULO) man -o $(SHARE)/man1 --quiet
	$(CUMULO) completions bash > $(SHARE)/completions/cumulo.bash
	$(CUMULO) completions zsh > $(SHARE)/completions/_cumulo
	$(CUMULO) completions fish > $(SHARE)/completions/cumulo.fish

install: share ## the program, built before by `make build` or `make demo`, with manual pages and completions
	install -D -m 755 $(CUMULO) $(DESTDIR)$(PREFIX)/bin/cumulo
	install -d $(DESTDIR)$(PREFIX)/share/man/man1
	install -m 644 $(SHARE)/man1/*.1 $(DESTDIR)$(PREFIX)/share/man/man1
	install -D -m 644 $(SHARE)/completions/cumulo.bash $(DESTDIR)$(PREFIX)/share/bash-completion/completions/cumulo
	install -D -m 644 $(SHARE)/completions/_cumulo $(DESTDIR)$(PREFIX)/share/zsh/site-functions/_cumulo
	install -D -m 644 $(SHARE)/completions/cumulo.fish $(DESTDIR)$(PREFIX)/share/fish/vendor_completions.d/cumulo.fish

# Packages and archives have the sources' time, so that the same sources make the same bytes. It is not for the build,
# whose C code would be compiled anew.
DATED := SOURCE_DATE_EPOCH=$(or $(SOURCE_DATE_EPOCH),$(shell stat --format=%Y Cargo.toml))

dist: build share ## target/dist/cumulo-*.tar.xz, with all libraries inside: unpack it on any Linux of this kind of machine
	python/setup.sh dist
	$(DATED) python/dist.sh

# `make deb DEBIAN=trixie` makes the package of another release.
DEBIAN ?=

deb: $(if $(DEBIAN),,build share) ## target/debian/cumulo_*.deb, for this release of Debian or Ubuntu
ifneq ($(DEBIAN),)
	$(DATED) python/debian.sh $(DEBIAN)
else
	$(DATED) python/deb.sh
endif

wheel: ## target/wheels/cumulo-*.whl, with OpenVDB inside: `pip install` it on a machine that has none of it
	python/wheel.sh

addon: wheel ## Blender's extension with the wheel in it: install it from target/cumulo-addon.zip
	/usr/bin/python3 python/addon/build.py target/cumulo-addon.zip --wheel target/wheels/*.whl

clean:
	rm -rf target demo-out .venvs
