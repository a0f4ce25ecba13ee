"""A terminal for tests: a program of which all streams are one, with the size that its window has."""

import codecs
import fcntl
import os
import pty
import re
import select
import signal
import struct
import termios
import time

from support import ROOT, executable

PATIENCE_S = 60.0
CTRL_C = "\x03"
ESCAPE = re.compile(r"\x1b\[(\??[\d;]*)([A-Za-z])")


class Terminal:
    """`hydraxis` with these arguments on a terminal, in a `with` statement.

        text    all that it has written
        code    exit code after `end`; negative: the signal that has ended it
    """

    def __init__(self, *arguments, rows=24, columns=80, folder=ROOT, environment=None):
        self.columns, self.text, self.code = columns, "", None
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")
        command = [os.path.abspath(executable()), *map(str, arguments)]
        self.pid, self._file = pty.fork()
        if self.pid == 0:
            try:
                fcntl.ioctl(0, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
                os.chdir(folder)
                os.execve(command[0], command, {**os.environ, "TERM": "xterm", **(environment or {})})
            finally:
                os._exit(127)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.code is None:
            os.kill(self.pid, signal.SIGTERM)
            try:
                self.end()
            except AssertionError:
                os.kill(self.pid, signal.SIGKILL)
                os.waitpid(self.pid, 0)
        os.close(self._file)

    def _read(self, seconds):
        """Takes in what is written within so many seconds; False after the end of the program."""
        if not select.select([self._file], [], [], seconds)[0]:
            return True
        try:
            data = os.read(self._file, 65536)
        except OSError:  # the other end is closed
            return False
        self.text += self._decoder.decode(data)
        return bool(data)

    def expect(self, pattern, count=1):
        """Waits until what was written has the pattern so many times."""
        until = time.monotonic() + PATIENCE_S
        while len(re.findall(pattern, self.text)) < count:
            assert self._read(0.1), f"the program has ended without {pattern!r}:\n{self.text}"
            assert time.monotonic() < until, f"waited for {pattern!r}:\n{self.text}"

    def type(self, text):
        os.write(self._file, text.encode())

    def answer(self, question, text):
        """Waits for a question that has not been answered yet, and answers it."""
        before = getattr(self, "_answered", 0)
        until = time.monotonic() + PATIENCE_S
        while not re.search(question, self.text[before:]):
            assert self._read(0.1), f"the program has ended without {question!r}:\n{self.text}"
            assert time.monotonic() < until, f"waited for {question!r}:\n{self.text}"
        self._answered = len(self.text)
        self.type(text + "\n")

    def end(self):
        """Waits for the end of the program; its exit code."""
        until = time.monotonic() + PATIENCE_S
        while self._read(0.1):
            assert time.monotonic() < until, f"waited for the end:\n{self.text}"
        self.code = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        return self.code

    def screens(self):
        """What stood on the terminal before each time that the cursor went up, and at the end: lists of lines.

        A line that is wider than the terminal takes several rows.
        """
        rows, row, column, found, place = [""], 0, 0, [], 0
        while place < len(self.text):
            escape = ESCAPE.match(self.text, place)
            letter = self.text[place]
            place = escape.end() if escape else place + 1
            if escape:
                number, kind = escape.groups()
                if kind == "A":
                    found.append([line.rstrip() for line in rows])
                    row = max(row - int(number or 1), 0)
                elif kind == "K":
                    rows[row] = rows[row][:column]
                elif kind == "J":
                    rows[row] = rows[row][:column]
                    del rows[row + 1:]
            elif letter == "\r":
                column = 0
            elif letter == "\n" or column == self.columns:
                row += 1
                column = 0
                rows += [""] * (row + 1 - len(rows))
            if not escape and letter not in "\r\n":
                rows[row] = rows[row][:column].ljust(column) + letter + rows[row][column + 1:]
                column += 1
        return [*found, [line.rstrip() for line in rows]]

    def window(self, rows=24):
        """The whole window as it stands now, for a program that writes at places of it: a list of lines."""
        window, row, column, place = [[" "] * self.columns for _ in range(rows)], 0, 0, 0
        while place < len(self.text):
            escape = ESCAPE.match(self.text, place)
            if escape and escape[2] == "H":
                row, column = (int(number) - 1 for number in escape[1].split(";"))
            elif not escape:
                window[row][column] = self.text[place]
                column += 1
            place = escape.end() if escape else place + 1
        return ["".join(line).rstrip() for line in window]

    def drawn_lines(self):
        """The lines that were drawn over others, without their colours."""
        return [ESCAPE.sub("", line) for line in re.findall(r"\x1b\[K([^\r\n]*)\r?\n", self.text)]
