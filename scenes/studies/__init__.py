"""Studies: what many runs tell beside each other, beside measurements, and beside what is published."""
