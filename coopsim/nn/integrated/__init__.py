"""Integrated detection and tracking (Hu, Wang and Wang): two branches that read a fused map.

In: a fused map, and the map and tracks of the frame before. Out: detections and tracks. Start reading at
`integrated_net`; `perceiver` runs it frame after frame.
"""
