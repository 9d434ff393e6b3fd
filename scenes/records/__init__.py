"""Results on disc: records, their store, figures and exports."""
