"""Validation: model results beside closed forms and beside measurements on robots and animals."""
