"""One part of each kind of your own, as a package beside FRIDA painter."""
