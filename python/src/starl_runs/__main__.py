"""python -m starl_runs PATH...: says what is there."""

import sys

from . import NotFromStarl, Recording, Run, Sweep, read


def lines(of):
    if isinstance(of, Run):
        report = of.report
        yield f"run of {report['app']}: {report['robots']} robots, {report['virtual_s']} s, " + (
            "complete" if of.complete else f"ended: {report['ending']}"
        )
        yield from (f"  {violation['text']}" for violation in of.violations)
    elif isinstance(of, Sweep):
        statuses = [run["status"] for run in of.runs]
        counts = ", ".join(f"{statuses.count(s)} {s}" for s in sorted(set(statuses)))
        yield f"sweep: {len(statuses)} runs: {counts}"
    elif isinstance(of, Recording):
        topics = of.topics
        yield f"recording: {sum(topics.values())} messages" + (", cut off" if of.cut_off else "")
        yield from (f"  {count:8} {topic}" for topic, count in sorted(topics.items()))


def main(paths=None):
    paths = sys.argv[1:] if paths is None else paths
    if not paths or paths[0] in ("-h", "--help"):
        print("usage: python -m starl_runs PATH...\nPATH: the directory of a run or sweep, or a recording")
        return 0 if paths else 2
    status = 0
    for path in paths:
        try:
            for line in lines(read(path)):
                print(line)
        except (NotFromStarl, OSError, ImportError, ValueError) as error:
            print(f"starl_runs: {error}", file=sys.stderr)
            status = 2
    return status


if __name__ == "__main__":
    sys.exit(main())
