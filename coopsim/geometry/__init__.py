"""Rigid transforms and upright boxes, as structs of arrays.

Poses and boxes come in; overlaps, similarities and one-to-one matchings go out. Start with `se3` and `boxes`; `iou`
compares boxes, `assignment` matches them, and `exact` is for code whose results must be the same on every processor.
"""
