"""Serves the controller of a file: ``python3 -m appell_plugin FILE``."""

import importlib.util
import json
import os
import struct
import sys
import traceback

import appell_plugin
from appell_plugin import Controller, Now

DESCRIBE, CREATE, STEP, DESTROY, SAVE, RESTORE, TAKE_OVER = range(1, 8)
ANSWER, REFUSED = 100, 200
HEAD = struct.Struct("<IHH")
PART = struct.Struct("<II")
CALL = struct.Struct("<IIdd")
MEMBER = struct.Struct("<I")


class Member:
    """A controller's life: parameters, memory and the instant."""

    def __init__(self, controller: Controller, parameters: dict, context: dict) -> None:
        self.parameters = parameters
        self.now = Now(context=context)
        self.memory = {}
        if controller.start is not None:
            self.memory = controller.start(context, parameters)


class Server:
    """Answers one request after the other."""

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self.inputs = [port["name"] for port in controller.descriptor["inputs"]]
        self.outputs = [port["name"] for port in controller.descriptor["outputs"]]
        self.numbers = struct.Struct(f"<{len(self.inputs)}d")
        self.results = struct.Struct(f"<{len(self.outputs)}d")
        self.members = {}

    def answer(self, kind: int, body: bytes) -> bytes:
        if kind == STEP:
            return self.step_many(body)
        if kind == DESCRIBE:
            return json.dumps(self.controller.descriptor).encode()
        if kind == CREATE:
            request = json.loads(body)
            member = Member(self.controller, request["parameters"], request["context"])
            self.members[request["member"]] = member
            return b""
        (number,) = MEMBER.unpack_from(body)
        if kind == DESTROY:
            self.members.pop(number, None)
            return b""
        member = self.members[number]
        if kind == SAVE:
            text = json.dumps([member.memory, member.now.before])
            if json.loads(text) != [member.memory, member.now.before]:
                raise ValueError("memory must be plain data: texts for keys, lists for tuples")
            return text.encode()
        if kind == RESTORE:
            member.memory, member.now.before = json.loads(body[MEMBER.size :])
            return b""
        if kind == TAKE_OVER:
            values = self.results.unpack_from(body, PART.size)
            member.now.before = dict(zip(self.outputs, values))
            return b""
        raise ValueError(f"requests of kind {kind} are unknown")

    def step_many(self, body: bytes) -> bytes:
        (count,) = MEMBER.unpack_from(body)
        at, answer = MEMBER.size, []
        for _ in range(count):
            number, _, t, dt = CALL.unpack_from(body, at)
            values = self.numbers.unpack_from(body, at + CALL.size)
            at += CALL.size + self.numbers.size
            try:
                answer.append(PART.pack(0, 0) + self.step(self.members[number], t, dt, values))
            except Exception as error:  # whatever a controller raises
                text = reason(error).encode()
                answer.append(PART.pack(1, len(text)) + text)
        return b"".join(answer)

    def step(self, member: Member, t: float, dt: float, values: tuple) -> bytes:
        now = member.now
        now.t, now.dt = t, dt
        inputs = dict(zip(self.inputs, values))
        result = self.controller.step(now, inputs, member.parameters, member.memory)
        now.before = None
        if isinstance(result, dict):
            unknown = [name for name in result if name not in self.outputs]
            missing = [name for name in self.outputs if name not in result]
            if unknown or missing:
                wrong = "not outputs: " + ", ".join(map(str, unknown)) if unknown else ""
                lacks = "missing: " + ", ".join(missing) if missing else ""
                raise ValueError("it must return its outputs; " + "; ".join(filter(None, [wrong, lacks])))
            result = [result[name] for name in self.outputs]
        elif isinstance(result, (int, float)):
            result = [result]
        elif result is None:
            raise ValueError("it must return its outputs, got None")
        if len(result) != len(self.outputs):
            raise ValueError(f"it must return {len(self.outputs)} outputs, got {len(result)}")
        return self.results.pack(*result)


def reason(error: Exception) -> str:
    """One line: what was raised, and where in the user's file."""
    if isinstance(error, SyntaxError) and error.filename:
        return f"SyntaxError: {error.msg} ({os.path.basename(error.filename)}, line {error.lineno})"
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename != __file__]
    text = traceback.format_exception_only(type(error), error)[-1].strip()
    if not frames:
        return text
    frame = frames[-1]
    return f"{text} ({os.path.basename(frame.filename)}, line {frame.lineno})"


def load(path: str) -> Controller:
    """The controller of a file."""
    sys.path.insert(0, os.path.dirname(os.path.abspath(path)))
    spec = importlib.util.spec_from_file_location("plugin", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules["plugin"] = module
    spec.loader.exec_module(module)
    found = appell_plugin.registered
    if len(found) != 1:
        names = ", ".join(c.descriptor["name"] for c in found) or "none"
        raise ValueError(f"the file must have one function marked @controller, got {names}")
    return found[0]


def main() -> None:
    # What the controller prints must not come among the messages.
    requests = os.fdopen(os.dup(0), "rb")
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    server, failure = None, None
    try:
        server = Server(load(sys.argv[1]))
    except Exception as error:  # whatever the file raises
        failure = reason(error)
    while True:
        head = requests.read(HEAD.size)
        if len(head) < HEAD.size:
            return
        length, kind, number = HEAD.unpack(head)
        body = requests.read(length)
        try:
            if server is None:
                raise RuntimeError(failure)
            answer, kind = server.answer(kind, body), kind + ANSWER
        except Exception as error:  # told, not fatal
            answer, kind = (failure or reason(error)).encode(), REFUSED
        answers.write(HEAD.pack(len(answer), kind, number) + answer)
        answers.flush()


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python3 -m appell_plugin FILE")
    main()
