"""Independent studies: many runs compared with each other, with measurements and with published numbers."""
