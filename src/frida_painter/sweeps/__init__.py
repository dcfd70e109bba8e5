"""Many runs as one thing: a sweep's file, the engine that does its runs, its folder, its table and its page."""
