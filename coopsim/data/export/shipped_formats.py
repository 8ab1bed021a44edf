"""The formats that ship with coopsim: importing registers them."""

from coopsim.data.export.opv2v_format import Opv2vFormat as Opv2vFormat
