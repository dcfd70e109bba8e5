"""Pretrained networks that compare pictures and words."""
