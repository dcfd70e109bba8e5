"""`python -m frida_painter` is the command `frida-painter`."""

from frida_painter.cli import main

main()
