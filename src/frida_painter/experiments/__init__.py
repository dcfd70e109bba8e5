"""The paper's figures and tables, and ours, each one command: `frida-painter experiments NAME`.

Every experiment is a module with a function `run(..., notify) -> Outcome` whose arguments are its
settings, and with a `FULL` and a `QUICK` scale: the same work, of which the quick one does just
enough to see that all of it runs. `outcome.py` says what comes out, `page.py` and `chart.py` draw.
"""
