"""Values that users give and get: checked, read-only, and of a size that fits in memory."""
