"""Exports as V2X-Seq-SPD, the sequences of a vehicle and a roadside unit."""
