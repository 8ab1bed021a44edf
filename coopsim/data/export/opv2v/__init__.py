"""OPV2V, and V2XSet, which has the same files."""
