# Two commands set everything up on a fresh machine: `make demo` (the main job on shipped examples) and `make test`.
PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin

.PHONY: demo test test-slow test-hostile test-planted test-all validate pages pictures challenge test-lowest test-newest test-pythons lint docs man dist space clean

demo: $(VENV)/demo.done
	$(BIN)/cavirheo infer examples/soft_gel.csv examples/stiff_gel.mat examples/bubble.mp4 --fps 500000 --um-per-px 4 -o demo-result

# on two processes, a file of tests on one of them
test: $(VENV)/test.done lint
	$(BIN)/python -m pytest -m "not slow and not hostile" -n 2 --dist loadfile --no-loadscope-reorder

test-slow: $(VENV)/test.done
	$(BIN)/python -m pytest -m slow -n 2 --dist loadfile --no-loadscope-reorder

# Hundreds of hostile and odd files through every room, and thousands of damaged ones: no traceback, hang or second line; a quarter hour
test-hostile: $(VENV)/test.done
	$(BIN)/python -m pytest -m hostile tests/nightly/test_corpus.py tests/io/test_hostile.py

# Errors planted in a copy of src, one at a time, that the tests must catch; a quarter hour
test-planted: $(VENV)/test.done
	$(BIN)/python tests/nightly/planted_errors.py

# The fast tests that need neither torch nor the browser app, with the oldest versions that pyproject.toml allows;
# schemas in tests/meta/golden are what today's versions write
test-lowest:
	$(PYTHON) -m venv build/lowest
	$(PYTHON) tests/lowest.py plot video > build/lowest.txt
	build/lowest/bin/pip install --quiet --disable-pip-version-check -c build/lowest.txt -e ".[plot,video]" pytest
	build/lowest/bin/python -m pytest -m "not slow and not hostile and not train" --ignore=tests/app --ignore=tests/meta/test_golden.py

# Every law and answers of known truth, with the newest Python that is found and the newest libraries for it
NEWEST ?= $(or $(lastword $(sort $(wildcard $(or $(PYENV_ROOT),$(HOME)/.pyenv)/versions/3.1[1-9].*/bin/python))),$(PYTHON))
test-newest:
	$(NEWEST) -m venv --clear build/newest
	build/newest/bin/pip install --quiet --disable-pip-version-check . pytest
	build/newest/bin/python -m pytest -m "not slow" tests/physics/test_materials.py tests/inference/test_truth.py

# The claims as numbers with their standard errors, in ten minutes; FULL=1 takes all cases, DATA=folder the open sets.
# For a release: make validate FULL=1 DATA=folder RESULTS=validation/results.json pages
RESULTS ?= build/validate.json
validate: $(VENV)/test.done
	$(BIN)/python -m validation $(if $(FULL),--full) $(if $(DATA),--data $(DATA)) -o $(RESULTS)

# The numbers between markers on pages, of validation/results.json; the picture of the packages
pages: $(VENV)/test.done
	$(BIN)/python -m validation --fill
	$(BIN)/python docs/site/way.py

# The six pictures of docs/pictures.md, and the answer on the app's first page; two minutes, and needs Chromium
pictures: $(VENV)/test.done
	$(BIN)/python docs/site/pictures.py

# Recordings of known truth, answered by cavirheo and by a plain least squares, and scored (validation/challenge/README.md)
CHALLENGE = build/challenge
SEED ?= 1
challenge: $(VENV)/demo.done
	$(BIN)/python -m validation.challenge.make $(CHALLENGE) --seed $(SEED)
	$(BIN)/python -m validation.challenge.run_cavirheo $(CHALLENGE)/recordings $(CHALLENGE)/infer.csv -- infer
	$(BIN)/python -m validation.challenge.run_cavirheo $(CHALLENGE)/recordings $(CHALLENGE)/fit.csv -- fit
	$(BIN)/python -m validation.challenge.run_cavirheo $(CHALLENGE)/recordings $(CHALLENGE)/infer-field.csv -- infer --bubble field
	$(BIN)/python -m validation.challenge.run_scipy $(CHALLENGE)/recordings $(CHALLENGE)/scipy.csv
	$(BIN)/python -m validation.challenge.score $(CHALLENGE)/truth.csv $(CHALLENGE)/infer.csv $(CHALLENGE)/fit.csv $(CHALLENGE)/infer-field.csv $(CHALLENGE)/scipy.csv -o $(CHALLENGE)/score

# What `make test` and .ci/run leave out, some hours; a target that fails does not stop the others
test-all:
	$(MAKE) --keep-going dist test-pythons test-lowest test-slow test-hostile test-planted docs validate

lint: $(VENV)/test.done
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# The site with the tutorials that are run for it, in build/site: opens from a folder, its search too, and asks nothing of any other machine
docs: $(VENV)/docs.done
	$(BIN)/mkdocs build --strict

man: $(VENV)/demo.done
	$(BIN)/python packaging/manual.py man/cavirheo.1

# dist/: sdist and wheel; the fast tests pass from the wheel, in an empty environment without an extra
dist: man
	$(BIN)/python tests/wheel.py

# The same with every Python that we support; it says which are not on this machine
test-pythons: man
	$(BIN)/python tests/wheel.py 3.11 3.12 3.13 3.14

# A folder that a hosted Gradio Space runs as it is (docs/how-to/app.md)
space: $(VENV)/demo.done
	rm -rf build/space && mkdir -p build && cp -r packaging/space build/space
	$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --target build/space .

$(VENV)/demo.done: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check -e ".[plot,video]"
	touch $@

# constraints.txt keeps torch on the version whose plain build needs no GPU libraries
$(VENV)/docs.done: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[docs,plot,video,cluster,app]"
	touch $@

$(VENV)/test.done: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[train,app,video,cluster,docs,dev]"
	touch $@

clean:
	rm -rf $(VENV) demo-result .pytest_cache .mypy_cache .ruff_cache
