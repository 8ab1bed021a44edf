"""Formats that ship with coopsim: importing registers them."""

from coopsim.data.export.kitti_format import KittiFormat as KittiFormat
from coopsim.data.export.nuscenes_format import NuscenesFormat as NuscenesFormat
from coopsim.data.export.opv2v_format import Opv2vFormat as Opv2vFormat
from coopsim.data.export.spd_format import SpdFormat as SpdFormat
