# Everything runs in .venv, which the first of these commands makes: Python 3.11 or newer is all it takes.

PYTHON ?= $(shell for p in python3.11 python3; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
READY := .venv/ready
KERNELS := .venv/kernels
IN := .venv/bin/

# What the page is drawn with: bundled once and committed, so that nobody who serves or opens it needs Node.
VENDOR := app/dashboard/static/vendor
THREE := 0.187.0
UPLOT := 1.6.32
ESBUILD := 0.28.2
THREE_NAMES := AmbientLight BufferAttribute BufferGeometry CircleGeometry Color CylinderGeometry DirectionalLight \
	DoubleSide DynamicDrawUsage Group GridHelper HemisphereLight Mesh MeshBasicMaterial MeshLambertMaterial \
	PerspectiveCamera Plane PlaneGeometry Raycaster RingGeometry Scene SphereGeometry Vector2 Vector3 WebGLRenderer

.PHONY: help demo test test-browser pictures check clean vendor

help: ## Say what there is to make
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-12s %s\n", $$1, $$2 }' Makefile

demo: $(READY) $(KERNELS) ## Train, recognise and re-enact simulated actions through a server
	$(IN)gesta demo

test: $(READY) $(KERNELS) ## Run the tests
	$(IN)pytest

test-browser: $(READY) $(KERNELS) ## Drive the page with Chromium, which Debian's packages give
	@command -v chromium >/dev/null || { \
		sudo=$$(test "$$(id -u)" = 0 || echo sudo); \
		$$sudo apt-get update -qq && $$sudo apt-get install -y -qq --no-install-recommends chromium fonts-dejavu-core; }
	$(IN)pytest -m browser tests/browser

pictures: $(READY) $(KERNELS) ## Take the pictures of the guides, with Chromium
	$(IN)pytest -m browser tests/browser/test_pictures.py --pictures docs/images

check: $(READY) ## Check style, types and architecture
	$(IN)ruff check
	$(IN)ruff format --check
	$(IN)mypy
	$(IN)pytest --quiet tests/test_architecture.py

vendor: ## Bundle the page's libraries anew, with npm
	@folder=$$(mktemp -d) && trap 'rm -rf "$$folder"' EXIT && \
	(cd $$folder && npm install --silent --no-audit --no-fund three@$(THREE) uplot@$(UPLOT) esbuild@$(ESBUILD)) && \
	{ echo 'export { $(shell echo $(THREE_NAMES) | sed "s/ /, /g") } from "three";'; \
	  for name in controls/OrbitControls lines/LineMaterial lines/LineSegments2 lines/LineSegmentsGeometry; do \
	    echo "export { $${name#*/} } from \"three/addons/$$name.js\";"; done; } > $$folder/three.js && \
	echo 'export { default } from "uplot";' > $$folder/uplot.js && \
	rm -rf $(VENDOR) && mkdir -p $(VENDOR) && \
	for name in three-$(THREE) uplot-$(UPLOT); do \
	  $$folder/node_modules/.bin/esbuild $$folder/$${name%%-*}.js --bundle --minify --format=esm --target=es2022 \
	    --legal-comments=none --log-level=warning --outfile=$(VENDOR)/$$name.js && \
	  cp $$folder/node_modules/$${name%%-*}/LICENSE $(VENDOR)/$$name.LICENSE || exit 1; done && \
	cp $$folder/node_modules/uplot/dist/uPlot.min.css $(VENDOR)/uplot-$(UPLOT).css && ls -l $(VENDOR)

clean: ## Remove .venv and what the tools and the demo left
	rm -rf .venv .hypothesis .mypy_cache .pytest_cache .ruff_cache *.egg-info build dist demo
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(READY): pyproject.toml
	@test -n '$(PYTHON)' || { echo 'Gesta needs Python 3.11 or newer: make PYTHON=/path/to/python' >&2; exit 1; }
	@echo 'Setting up .venv, once: a minute or two'
	$(PYTHON) -m venv .venv
	$(IN)pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@

# What numba has compiled of a file does not hang on the files that it calls: after a change it all goes.
$(KERNELS): $(wildcard app/motion/*.py) | $(READY)
	@rm -f app/motion/__pycache__/*.nb?
	@touch $@
