"""Networks that others have trained, through which pictures and words can be compared."""
