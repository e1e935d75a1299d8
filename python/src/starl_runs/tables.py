"""Tables: lists of dicts, from CSV files, and data frames of them where pandas is installed."""

import csv


def number_or_text(cell):
    """A cell as a number if it is one, as None if it is empty, else as it is."""
    if cell == "":
        return None
    for kind in (int, float):
        try:
            return kind(cell)
        except ValueError:
            pass
    return cell


def rows(path, texts=()):
    """The rows of a CSV file. The columns in `texts` stay texts, though they may look like numbers."""
    with open(path, newline="", encoding="utf-8") as lines:
        return [
            {
                key: cell if key in texts else number_or_text(cell)
                for key, cell in row.items()
                if key is not None
            }
            for row in csv.DictReader(lines)
        ]


def frame(table):
    """A data frame of pandas."""
    try:
        import pandas
    except ImportError as missing:
        raise ImportError("frames need pandas: pip install 'starl-runs[frames]'") from missing
    return pandas.DataFrame(table)
