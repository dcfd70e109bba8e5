"""Separate process that asks the hub of `transformers`; its starter watches how fast bytes come, and can end it.

It runs as a file, so that it imports only the hub's library. It is given "list" or "fetch", the file for its answer,
a repository, and the files to be fetched. It ends with its starter, who holds the other end of its standard input.
"""

import json
import os
import sys
import threading
from pathlib import Path

_PATIENCE = 10.0  # seconds for each part of an answer
_CHUNK = 2**14  # bytes; only whole chunks are written, and only what is written can be watched


def main() -> None:
    """Writes the sizes of a repository's files, or the folder of the fetched ones, as JSON."""
    threading.Thread(target=_end_with_starter, daemon=True).start()
    what, answer, repository, *files = sys.argv[1:]
    from huggingface_hub import HfApi, constants, hf_hub_download

    constants.DOWNLOAD_CHUNK_SIZE = _CHUNK
    try:
        if what == "list":
            found = HfApi().model_info(repository, files_metadata=True, timeout=_PATIENCE).siblings or ()
            told: object = {file.rfilename: file.size or 0 for file in found}
        else:
            paths = [Path(hf_hub_download(repository, file, etag_timeout=_PATIENCE)) for file in files]
            told = str(paths[0].parents[files[0].count("/")])
    except Exception as cause:  # the hub's library raises errors of several others
        first = cause.__cause__ or cause  # the hub's own error only says that something went wrong
        sys.exit(" ".join(str(first).split())[:160].rstrip(".") or type(first).__name__)
    Path(answer).write_text(json.dumps(told))


def _end_with_starter() -> None:
    while os.read(0, 1):
        pass
    os._exit(1)


if __name__ == "__main__":
    main()
