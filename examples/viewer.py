"""Shows a running painting in a browser, from its folder alone: python examples/viewer.py FOLDER PORT."""

import hashlib
import json
import sys
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

PAGE = "<meta http-equiv=refresh content=2><p>{done} of {of} strokes; last: {last}<p><img src=picture?{done}>"


def read(journal: Path) -> dict:
    """The state of the painting, from its journal, as docs/reference/files.md describes it."""
    now, before = {"last": "", "done": 0, "of": 0, "picture": ""}, b"0" * 16
    for line in journal.read_bytes().split(b"\n")[:-1]:  # what follows the last one is still being written
        checksum, _, text = line.split(b" ", 2)
        assert hashlib.sha256(before + text).hexdigest()[:16] == checksum.decode(), "the journal was changed"
        before, event = checksum, json.loads(text)
        kind = event["kind"]
        now["last"] = kind.replace("_", " ")
        now["of"] = event["strokes"] if kind == "scheduled" else now["of"]
        now["done"] = event["done"] if kind in ("stroke_painted", "stroke_left_out") else now["done"]
        if kind in ("looked", "timelapse_frame"):
            shown = event.get("pictures", event)
            now["picture"] = shown.get("seen") or shown.get("picture") or now["picture"]
    return now


class Viewer(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        now = read(FOLDER / "journal")
        wanted = now["picture"] if "picture" in self.path else ""
        self.wfile.write(b"HTTP/1.0 200 OK\r\n\r\n")
        self.wfile.write((FOLDER / wanted).read_bytes() if wanted else PAGE.format(**now).encode())


if __name__ == "__main__":
    FOLDER, server = Path(sys.argv[1]), ThreadingHTTPServer(("127.0.0.1", int(sys.argv[2])), Viewer)
    print(f"http://127.0.0.1:{server.server_port}", flush=True)
    server.serve_forever()
