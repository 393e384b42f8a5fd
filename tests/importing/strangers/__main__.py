"""Imports random buildings of known truth and prints what became of them, by format.

python -m tests.importing.strangers --number 5 --formats osm,imdf
"""

import argparse
import re
import shutil
import tempfile
import traceback
import warnings
from collections import Counter
from pathlib import Path

from tests.importing.strangers import FORMATS
from tests.importing.strangers.judge import VERDICTS, judge


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--number", type=int, default=5, help="buildings of each format")
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--formats", default=",".join(FORMATS))
    parser.add_argument("--keep", type=Path, help="folder for the files and their cases")
    parser.add_argument("--all", action="store_true", help="print all differences, not the first three")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    table = {}
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.keep or Path(temporary)
        folder.mkdir(exist_ok=True)
        for name in options.formats.split(","):
            table[name] = Counter()
            for seed in range(options.first, options.first + options.number):
                shutil.rmtree(folder / f"{name}_{seed}", ignore_errors=True)
                try:
                    stranger = FORMATS[name](seed, folder)
                    verdict, texts = judge(stranger, folder / f"{name}_{seed}")
                except Exception:
                    verdict, texts = "failed", [traceback.format_exc()[-1500:]]
                table[name][verdict] += 1
                if verdict != "right":
                    print(f"{name} {seed}: {verdict}", flush=True)
                    for text in texts if options.all else texts[:3]:
                        print("   ", re.sub(r"\s+", " ", text)[: 1500 if options.all else 400])
    print(f"\n{'':12}" + "".join(f"{verdict:>18}" for verdict in (*VERDICTS, "failed")))
    for name, counts in table.items():
        print(f"{name:12}" + "".join(f"{counts[verdict]:>18}" for verdict in (*VERDICTS, "failed")))


if __name__ == "__main__":
    main()
