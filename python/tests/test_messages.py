"""The messages are those of the layout that they name, and the package has the version of Hydraxis."""

import ctypes
import re
import unittest

from support import ROOT, hydraxis
from hydraxis import messages

KINDS = {ctypes.c_double: b"f64", ctypes.c_uint32: b"u32", ctypes.c_uint64: b"u64", ctypes.c_int64: b"i64",
         ctypes.c_uint8: b"u8"}


def fold(data, value=0xCBF29CE484222325):
    for byte in data:
        value = (value ^ byte) * 0x100000001B3 % 2**64
    return value


def number(n):
    return n.to_bytes(8, "little")


def fingerprint(kind):
    """FNV-1a over name, type and offset of every field, as pipeline/src/layout.rs makes it."""
    if issubclass(kind, ctypes.Array):
        return fold(b"array" + number(kind._length_), fingerprint(kind._type_))
    if not issubclass(kind, ctypes.Structure):
        return fold(KINDS[kind])
    value = fold(kind.__name__.encode())
    for name, field in kind._fields_:
        value = fold(name.encode() + number(fingerprint(field)) + number(getattr(kind, name).offset), value)
    return value


class Messages(unittest.TestCase):
    def test_every_message_has_the_layout_that_it_names(self):
        self.assertEqual(len(messages.MESSAGES), 8)
        for channel, kind in messages.MESSAGES.items():
            self.assertEqual(f"{fingerprint(kind):016x}", kind.LAYOUT, channel)
            self.assertEqual((ctypes.sizeof(kind), channel), (kind.SIZE, kind.CHANNEL))

    def test_bits_have_the_names_that_the_command_prints(self):
        bits = messages.ControlFlag.NO_MODEL | messages.ControlFlag.EMERGENCY_STOP | 1 << 31
        self.assertEqual(hydraxis.names_of(bits, messages.ControlFlag), ["no-model", "emergency-stop"])
        self.assertEqual(hydraxis.names_of(0, messages.SampleFault), [])

    def test_package_and_hydraxis_have_one_version(self):
        found = re.search(r'\[workspace.package\]\nversion = "(.*)"', (ROOT / "Cargo.toml").read_text())[1]
        self.assertIn(f'version = "{found}"', (ROOT / "python" / "pyproject.toml").read_text())
        self.assertEqual(hydraxis.__version__, found)


if __name__ == "__main__":
    unittest.main()
