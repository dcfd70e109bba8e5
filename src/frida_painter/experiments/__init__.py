"""The paper's figures and tables, and ours, each one command: `frida-painter experiments NAME`.

An experiment is a list of trials, a judge and a report (`trials.py`). A trial that is a painting is a RunSpec, and
PaintingRun plans and paints it (`paintings.py`). Every module has a `FULL` scale and a `QUICK` one: the same work, of
which the quick one does just enough to see that all of it runs.
"""
