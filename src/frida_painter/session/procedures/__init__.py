"""The calibration procedures: each a conversation with whoever stands at the easel."""
