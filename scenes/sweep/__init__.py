"""Sweeps: one scene many times, some of its keys varied; case by case in files, so that nothing finished is lost."""
