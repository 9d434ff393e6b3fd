"""Validation: what the models give beside closed forms and beside what was measured on robots and animals."""
