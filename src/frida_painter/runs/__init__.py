"""One painting as a thing: what describes it, what runs it, what lies in its folder."""
