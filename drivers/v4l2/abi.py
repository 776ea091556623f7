"""Structures and request numbers of the kernel's V4L2 interface (linux/videodev2.h)."""

import ctypes
from ctypes import (
    Structure,
    Union,
    c_char,
    c_int32,
    c_int64,
    c_long,
    c_uint8,
    c_uint32,
    c_ulong,
)
from enum import IntEnum, IntFlag

CAPTURE = 1  # V4L2_BUF_TYPE_VIDEO_CAPTURE
MMAP = 1  # V4L2_MEMORY_MMAP
ANY_FIELD, PROGRESSIVE = 0, 1
# the highest bit of a pixel format marks big-endian pixels
WITHOUT_BYTE_ORDER = 0x7FFFFFFF


def _u32(names: str) -> tuple[tuple[str, type[c_uint32]], ...]:
    """Unsigned 32-bit fields with these `names`, for `_fields_` of a structure."""
    return tuple((name, c_uint32) for name in names.split())


class Capability(Structure):
    """struct v4l2_capability: identity and capabilities of the device."""

    _fields_ = (
        ("driver", c_char * 16),
        ("card", c_char * 32),
        ("bus_info", c_char * 32),
        *_u32("version capabilities device_caps"),
        ("reserved", c_uint32 * 3),
    )


class FormatDescription(Structure):
    """struct v4l2_fmtdesc: one pixel format that the device offers."""

    _fields_ = (
        *_u32("index type flags"),
        ("description", c_char * 32),
        *_u32("pixelformat mbus_code"),
        ("reserved", c_uint32 * 3),
    )


class Fraction(Structure):
    """struct v4l2_fract: a ratio of two integers."""

    _fields_ = (("numerator", c_uint32), ("denominator", c_uint32))


class FrameSize(Structure):
    """struct v4l2_frmsizeenum: a size; `steps` are min, max, step of width, then of
    height.
    """

    _fields_ = (
        *_u32("index pixel_format type"),
        ("steps", c_uint32 * 6),
        ("reserved", c_uint32 * 2),
    )


class FrameInterval(Structure):
    """struct v4l2_frmivalenum: a frame interval; `steps` are min, max, step."""

    _fields_ = (
        *_u32("index pixel_format width height type"),
        ("steps", Fraction * 3),
        ("reserved", c_uint32 * 2),
    )


class PixFormat(Structure):
    """struct v4l2_pix_format: size, pixel format and memory layout of a picture."""

    _fields_ = _u32(
        "width height pixelformat field bytesperline sizeimage colorspace priv flags"
        " ycbcr_enc quantization xfer_func"
    )


class _AnyFormat(Union):
    _fields_ = (("pix", PixFormat), ("raw", c_uint8 * 200), ("align", c_ulong))


class Format(Structure):
    """struct v4l2_format: format of a stream; only the single-plane capture member is
    used.
    """

    _fields_ = (("type", c_uint32), ("fmt", _AnyFormat))


class CaptureParameters(Structure):
    """struct v4l2_captureparm: frame period and buffers of a capture stream."""

    _fields_ = (
        *_u32("capability capturemode"),
        ("timeperframe", Fraction),
        *_u32("extendedmode readbuffers"),
        ("reserved", c_uint32 * 4),
    )


class _AnyParameters(Union):
    _fields_ = (("capture", CaptureParameters), ("raw", c_uint8 * 200))


class StreamParameters(Structure):
    """struct v4l2_streamparm: rate of a stream; only the capture member is used."""

    _fields_ = (("type", c_uint32), ("parm", _AnyParameters))


class BufferRequest(Structure):
    """struct v4l2_requestbuffers: number and memory type of buffers to allocate."""

    _fields_ = (
        *_u32("count type memory capabilities"),
        ("flags", c_uint8),
        ("reserved", c_uint8 * 3),
    )


class TimeValue(Structure):
    """struct timeval of a 64-bit machine: seconds and microseconds."""

    _fields_ = (("seconds", c_long), ("microseconds", c_long))


class _TimeCode(Structure):
    _fields_ = (*_u32("type flags"), ("digits", c_uint8 * 4), ("userbits", c_uint8 * 4))


class _Memory(Union):
    _fields_ = (("offset", c_uint32), ("userptr", c_ulong))


class Buffer(Structure):
    """struct v4l2_buffer; the kernel rewrites it on every call, QBUF included."""

    _fields_ = (
        *_u32("index type bytesused flags field"),
        ("timestamp", TimeValue),
        ("timecode", _TimeCode),
        *_u32("sequence memory"),
        ("m", _Memory),
        *_u32("length reserved2"),
        ("request_fd", c_int32),
    )


class ControlQuery(Structure):
    """struct v4l2_queryctrl: range and state of one control."""

    _fields_ = (
        *_u32("id type"),
        ("name", c_char * 32),
        ("minimum", c_int32),
        ("maximum", c_int32),
        ("step", c_int32),
        ("default_value", c_int32),
        ("flags", c_uint32),
        ("reserved", c_uint32 * 2),
    )


class _MenuEntry(Union):
    _pack_ = 1
    _fields_ = (("name", c_char * 32), ("value", c_int64))


class MenuQuery(Structure):
    """struct v4l2_querymenu: one entry of a menu control."""

    _pack_ = 1
    _fields_ = (*_u32("id index"), ("entry", _MenuEntry), ("reserved", c_uint32))


class Control(Structure):
    """struct v4l2_control: id and value of one control."""

    _fields_ = (("id", c_uint32), ("value", c_int32))


Number = ctypes.c_int
Argument = Structure | Number

_IOC_WRITE, _IOC_READ, _IOC_BOTH = 1, 2, 3


def _request(direction: int, number: int, argument: type) -> int:
    """Number of a V4L2 request for ioctl, encoded as in asm-generic/ioctl.h."""
    return direction << 30 | ctypes.sizeof(argument) << 16 | ord("V") << 8 | number


class Ioctl(IntEnum):
    """Request numbers VIDIOC_* of V4L2 for ioctl, which contain the size of the
    argument.
    """

    QUERYCAP = _request(_IOC_READ, 0, Capability)
    ENUM_FMT = _request(_IOC_BOTH, 2, FormatDescription)
    S_FMT = _request(_IOC_BOTH, 5, Format)
    REQBUFS = _request(_IOC_BOTH, 8, BufferRequest)
    QUERYBUF = _request(_IOC_BOTH, 9, Buffer)
    QBUF = _request(_IOC_BOTH, 15, Buffer)
    DQBUF = _request(_IOC_BOTH, 17, Buffer)
    STREAMON = _request(_IOC_WRITE, 18, Number)
    STREAMOFF = _request(_IOC_WRITE, 19, Number)
    G_PARM = _request(_IOC_BOTH, 21, StreamParameters)
    S_PARM = _request(_IOC_BOTH, 22, StreamParameters)
    G_CTRL = _request(_IOC_BOTH, 27, Control)
    S_CTRL = _request(_IOC_BOTH, 28, Control)
    QUERYCTRL = _request(_IOC_BOTH, 36, ControlQuery)
    QUERYMENU = _request(_IOC_BOTH, 37, MenuQuery)
    ENUM_FRAMESIZES = _request(_IOC_BOTH, 74, FrameSize)
    ENUM_FRAMEINTERVALS = _request(_IOC_BOTH, 75, FrameInterval)


class CapabilityFlag(IntFlag):
    """V4L2_CAP_*: capabilities of a device that the driver checks."""

    VIDEO_CAPTURE = 0x00000001
    STREAMING = 0x04000000
    DEVICE_CAPS = 0x80000000


class BufferFlag(IntFlag):
    """V4L2_BUF_FLAG_*: flags of a dequeued buffer that the driver checks."""

    ERROR = 0x0040
    TIMESTAMP_MASK = 0xE000
    TIMESTAMP_MONOTONIC = 0x2000
    SOURCE_MASK = 0x00070000
    SOURCE_START_OF_EXPOSURE = 0x00010000


class ControlFlag(IntFlag):
    """V4L2_CTRL_FLAG_*: states that forbid setting or reading a control; NEXT
    enumerates them.
    """

    DISABLED = 0x0001
    GRABBED = 0x0002
    READ_ONLY = 0x0004
    INACTIVE = 0x0010
    WRITE_ONLY = 0x0040
    NEXT = 0x80000000


class ControlType(IntEnum):
    """V4L2_CTRL_TYPE_*: types of controls that hold one 32-bit number, as the driver
    supports.
    """

    INTEGER = 1
    BOOLEAN = 2
    MENU = 3
    BUTTON = 4
    BITMASK = 8
    INTEGER_MENU = 9


def fourcc(code: str) -> int:
    """V4L2 number of the pixel format with the four letters `code`, such as "YUYV"."""
    return int.from_bytes(code.encode("ascii"), "little")


def letters(number: int) -> str:
    """Four letters of the pixel format with the V4L2 `number`, such as "YUYV"."""
    return (
        (number & WITHOUT_BYTE_ORDER).to_bytes(4, "little").decode("latin-1").rstrip()
    )
