"""Fitting of a learned segment law to finite elements or to measured bench data."""
