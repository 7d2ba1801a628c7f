"""Makes tables of faults from their rows: how long the wheels turned."""

import math
import re
import statistics
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

from vsx_ros.experiments.rows import Row

_POSES = "slam", "odometry"


def nodes(rows: Sequence[Row]) -> list[str]:
    """Nodes killed, hung or stopped; turned_s is -1 if the wheels did not stop."""
    lines = ["| node | what happened to it | wheels turned: median | most | repetitions |", "|---|---|---|---|---|"]
    for (node, how), results in _parts(rows, "node", "how"):
        turned, on = _stopped(results)
        median, most = (f"{of(turned):.3f} s" if turned else "-" for of in (statistics.median, max))
        worst = f"{on} did not stop" if on else most
        node = node.replace("guardian", "watchdog")  # the name in older rows
        lasted = sum(not result.get("ended", True) for result in results)
        count = f"{len(results)}{f'; in {lasted} the process did not end' * bool(lasted)}"
        lines.append(f"| {node} | {how} | {median}{f' of {len(turned)}' * bool(on)} | {worst} | {count} |")
    return lines


def robots(rows: Sequence[Row]) -> list[str]:
    """Camera faults of an exploring robot; turned_s is -1 if it did not stand for the fault."""
    lines = [
        "| fault of the camera | stood after: median, most | wheels turned in the four seconds: median, most "
        "| what the robot says then | four seconds later |",
        "|---|---|---|---|---|",
    ]
    for (fault,), results in _parts(rows, "fault"):
        moved = [result["moved_s"] for result in results if "moved_s" in result]
        said = _counts([_without_numbers(f"{_first(result['slam'])}; {result['follower']}") for result in results])
        later = _counts([_state(result["later"]) for result in results])
        turned = _spread(moved) if moved else "not measured"
        lines.append(f"| {fault} | {_stood(results)} | {turned} | {said} | {later} |")
    if any("moved_s" not in row.result for row in rows):
        lines += ["", "*These rows count every standstill, also an arrival, and began wherever the one before ended.*"]
    return lines


def bases(rows: Sequence[Row]) -> list[str]:
    """turned_s is -1 if the base drove on."""
    lines = ["| base | fault | wheels turned (median, most of n) | what the driver says |", "|---|---|---|---|"]
    for (base, fault), results in _parts(rows, "base", "fault"):
        lines.append(f"| {base} | {fault} | {_turned(results)} | {results[-1]['said']} |")
    return lines


def cameras(rows: Sequence[Row]) -> list[str]:
    """Faults at the driver."""
    lines = ["| fault of the camera | two seconds at the driver |", "|---|---|"]
    for (fault,), results in _parts(rows, "fault"):
        lines.append(f"| {fault} | {results[-1]['arrived']} |")
    return lines


def masters(rows: Sequence[Row]) -> list[str]:
    """A new master after a while; turned_s is -1 if the wheels did not stop, path_s None if the base could not be
    stopped again, driving_s None if the run ended."""
    lines = [
        "| no master for | wheels turned: median, most | moved before it could be stopped | stop path there after "
        "| drives again after | 'vsx stop' stops it |",
        "|---|---|---|---|---|---|",
    ]
    for (away_s,), results in sorted(_parts(rows, "away_s"), key=lambda part: float(part[0][0])):
        driving = [result["driving_s"] for result in results if result["driving_s"] is not None]
        paths = [result["path_s"] for result in results if result["path_s"] is not None]
        (turned, on), n = _stopped(results), len(results)
        never = f" of {len(paths)}; {n - len(paths)} not within a minute" * (len(paths) < n)
        lines.append(
            f"| {float(away_s):g} s | {_spread(turned)}{f' of {len(turned)}; {on} did not stop' * bool(on)} "
            f"| {sum(result['moved_before'] for result in results)} of {n} "
            f"| {_spread(paths)}{never} "
            f"| {_spread(driving)} of {len(driving)} | {sum(result['stopped'] for result in results)} of {n} |"
        )
    return lines


def posts(rows: Sequence[Row]) -> list[str]:
    """An obstacle that appears on the path; rest_s is None if the base did not come to rest."""
    lines = [
        "| the post's face ahead of the base's centre | no contact | speed | at rest after: median, most "
        "| least gap: median, least | drawn again |",
        "|---|---|---|---|---|---|",
    ]
    for (ahead_m,), results in _parts(rows, "ahead_m"):
        missed, n = sum(not result["contact"] for result in results), len(results)
        rested = [result["rest_s"] for result in results if result["rest_s"] is not None]
        on = f"; {n - len(rested)} not within 5 s" * (len(rested) < n)
        least = [100.0 * result["least_m"] for result in results]
        counted = [result["redrawn"] for result in results if "redrawn" in result]
        again = [100.0 * gap_m for gaps in counted for gap_m in gaps]
        drawn = f"{len(again)}{f', least gap {min(again):.0f} cm' if again else ''}" if counted else "not counted"
        lines.append(
            f"| {float(ahead_m):g} m | {missed} of {n} | {statistics.median(r['speed_m_s'] for r in results):.2f} m/s "
            f"| {_spread(rested)} of {len(rested)}{on} | {statistics.median(least):.0f} cm, {min(least):.0f} cm "
            f"| {drawn} |"
        )
    return lines


def operators(rows: Sequence[Row]) -> list[str]:
    """An operator who takes the wheels; went_on_s is None if the robot did not explore on by itself."""
    lines = [
        "| the operator | said by mission, base and event | said after: median, most "
        "| wheels do as he says after: median, most; then otherwise | goals given meanwhile "
        "| views blacklisted for it | explored on after: median, most |",
        "|---|---|---|---|---|---|---|",
    ]
    acts = {"emergency stop": "presses the emergency stop", "teleop": "drives by teleop", "goal": "sends it to a goal"}
    for (what,), results in _parts(rows, "what"):
        told, goals, listed = (sum(result[key] for result in results) for key in ("told", "goals", "blacklisted"))
        said, on = ([r[key] for r in results if r[key] is not None] for key in ("said_s", "went_on_s"))
        sent = [result["reached"] for result in results if result.get("reached") is not None]
        reached = f" ({sum(sent)} of {len(sent)} reached)" if sent else ""
        wheels = "-" if what == "goal" else _obeyed(results)
        lines.append(
            f"| {acts[what]}{reached} | {told} of {len(results)} | {_spread(said)} | {wheels} | {goals} | {listed} "
            f"| {_spread(on)} of {len(on)} |"
        )
    return lines


def disks(rows: Sequence[Row]) -> list[str]:
    """Results of the runs whose disk failed, by the way they ended."""
    lines = [
        "| run | fault of the disk | good | ended by | ended after its end: median, most | kept its summary "
        "| files looked at, least |",
        "|---|---|---|---|---|---|---|",
    ]
    for (how, fault), results in _parts(rows, "how", "fault"):
        of = [row for row in rows if (row.asked["how"], row.asked["fault"]) == (how, fault)]
        ends = Counter({**row.asked, **row.result}["ended_by"] for row in of)  # older rows tell it in their result
        good, kept = (sum(bool(result[key]) for result in results) for key in ("good", "summary"))
        ended_by = ", ".join(f"{n} {end}" for end, n in ends.items())
        times = [result["ended_s"] for result in results if result["ended_s"] is not None]
        took = _spread(times) + f" of {len(times)}" * (len(times) < len(results))
        files = min((result["files"] for result in results if "files" in result), default="not counted")
        lines.append(f"| {how} | {fault} | {good} of {len(results)} | {ended_by} | {took} | {kept} | {files} |")
    return lines


def sensors(rows: Sequence[Row]) -> list[str]:
    """The worst of all motions."""
    lines = [
        "| base | sensor | fault | told within | what the robot does | pose jumps by at most | heading off after 4 s |",
        "|---|---|---|---|---|---|---|",
    ]
    for (base, sensor, fault), results in _parts(rows, "base", "sensor", "fault"):
        asked = {"base": base, "sensor": sensor, "fault": fault}
        told = _told([row for row in rows if row.asked == row.asked | asked])
        stood, n = [result["stood_s"] for result in results if result["stood_s"] is not None], len(results)
        some = f" in {len(stood)} of {n}" * (len(stood) < n)
        then = f"stands within {max(stood):.1f} s{some}" if stood else "goes on"
        by_gyro = sum(result["as_slip"] and abs(result["wrong_rad"]) > 0.1 for result in results)
        then += f"; in {by_gyro} of {n} by the gyro, as if the wheels slipped" if by_gyro else ""
        jump_cm = 100.0 * max(result["jump_m"] for result in results)
        jump, off = (math.degrees(max(abs(r[k]) for r in results)) for k in ("jump_rad", "wrong_rad"))
        name = {"left": "left encoder", "right": "right encoder", "both": "both encoders"}.get(sensor, sensor)
        lines.append(
            f"| {base} | {name} | {fault} | {told} | {then} | {jump_cm:.1f} cm, {jump:.1f} deg | {off:.0f} deg |"
        )
    return lines


def alarms(rows: Sequence[Row]) -> list[str]:
    """False alarms on drives without faults."""
    bases = list(dict.fromkeys(row.asked["base"] for row in rows))
    lines = [f"| wheels, {rows[0].asked['minutes']:.0f} minutes each | {' | '.join(bases)} |", "|---" * 4 + "|"]
    for (wheels,), results in _parts(rows, "wheels"):
        lines.append(f"| {wheels} | " + " | ".join(str(result["alarms"]) for result in results) + " |")
    return lines


def files(rows: Sequence[Row]) -> list[str]:
    """Damaged files, by reader."""
    lines = [
        "| reader | damaged files | read | refused in a sentence | neither | slowest | most memory |",
        "|---|---|---|---|---|---|---|",
    ]
    for (reader,), results in _parts(rows, "reader"):
        read, refused = (sum(result["outcomes"].get(key, 0) for result in results) for key in ("read", "refused"))
        count = sum(sum(result["outcomes"].values()) for result in results)
        slowest_s, most_mib = (max(result[key] for result in results) for key in ("slowest_s", "most_mib"))
        took = f"{slowest_s:.1f} s | {most_mib:.0f} MiB"
        lines.append(f"| {reader} | {count} | {read} | {refused} | {count - read - refused} | {took} |")
    return lines


def soaks(rows: Sequence[Row]) -> list[str]:
    """The stack under faults of all devices and processes."""
    lines = [
        "| minutes | faults | tracebacks | died by themselves | missions that ended | contacts | way | pose off (rms) "
        "| odometry off since its counting began (rms) |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    lines += map(_soak, rows)
    lives = [life for row in rows for life in row.result["lives"]]
    if lives:
        head = "| process | lives | the longest, since it was warm | its memory then | grew by | of that the map"
        lines += ["", f"{head} | most at work beside | keyframes that came |", "|---|---|---|---|---|---|---|---|"]
    for name in dict.fromkeys(life["name"] for life in lives):
        of_name = [life for life in lives if life["name"] == name]
        longest = max(of_name, key=lambda life: life["minutes"])
        of_map, work = (f"{longest[n]:.1f} MB" if n in longest else "not measured" for n in ("map_mb", "working_mb"))
        grown = f"{longest['warm_mb']:.0f} MB | {longest['grown_mb']:.1f} MB | {of_map} | {work}"
        told = f"{len(of_name)} | {longest['minutes']:.0f} minutes | {grown} | {longest['keyframes']}"
        lines.append(f"| {name} | {told} |")
    return lines


def _told(rows: Sequence[Row]) -> str:
    """How soon a broken sensor is told, and on which motions it is not. refused: frames that the driver refused, in
    newer rows."""
    told_s = [row.result["told_s"] for row in rows if row.result["told_s"] is not None]
    untold = [row for row in rows if row.result["told_s"] is None]
    motions = f" ({', '.join(row.asked['motion'] for row in untold)})" if told_s else ""
    refused = sum(row.result.get("refused", 0) > 0 for row in untold)
    words = [f"{max(told_s):.1f} s"] if told_s else []
    words += [f"not told in {len(untold)} of {len(rows)}{motions}"] if untold else []
    words += [f"a frame refused in {refused} of them"] if refused else []
    return "; ".join(words)


def _obeyed(results: Sequence[dict[str, Any]]) -> str:
    """When the wheels first did as the operator says, and how long later they did not, in all repetitions."""
    known = [result for result in results if "obeyed_s" in result]
    if not known:
        return "not measured"
    after = [result["obeyed_s"] for result in known if result["obeyed_s"] is not None]
    otherwise, idle = (sum(result[key] or 0.0 for result in known) for key in ("else_s", "idle_s"))
    stood = f", stood for {idle:.2f} s" if idle else ""
    return f"{_spread(after)} of {len(after)}; turned for {otherwise:.2f} s{stood}"


def _stood(results: Sequence[dict[str, Any]]) -> str:
    """When the wheels stood for a fault, and how often they stood for another reason before, or not at all."""
    times, on = _stopped(results)
    stayed, n = sum(map(_stays, results)), len(results)
    words = [f"{statistics.median(times):.3f} s, {max(times):.3f} s of {len(times)}"] if times else []
    words += [f"{stayed} of {n} stood for another reason, and stayed"] if stayed else []
    words += [f"{on - stayed} of {n} did not"] if on > stayed else []
    before = sum(bool(result.get("others")) and not _stays(result) for result in results)
    words += [f"{before} of {n} also stood before, for another reason"] if before else []
    return "; ".join(words)


def _stays(result: dict[str, Any]) -> bool:
    """Whether the base stood for another reason, and stands at the end."""
    return bool(result.get("others")) and result["turned_s"] < 0.0 and result["later"].startswith("standing")


def _state(later: str) -> str:
    """Without numbers, without where SLAM has its pose from, and without what the mission is doing."""
    return _without_numbers(re.sub(r"; position by [^;]*|(; (?:mapping|recovering|no images)): .*", r"\1", later))


def _first(words: str) -> str:
    return words.partition("; ")[0]


def _without_numbers(words: str) -> str:
    return re.sub(r"-?\d+(\.\d+)?", "n", words)


def _counts(words: Sequence[str]) -> str:
    """Each with its count, the most frequent first; one that all share without."""
    counts = Counter(words).most_common()
    return counts[0][0] if len(counts) == 1 else " / ".join(f"{n} of {len(words)}: {each}" for each, n in counts)


def _soak(row: Row) -> str:
    """The line of an hour. Older rows count no missions; their nodes wrote to the disk that was filled, and what they
    have of the odometry are its restarts."""
    of, missions, stretches = row.result, row.result.get("missions"), row.result.get("odometry_stretches")
    unheard = " while the disk was not full" if missions is None and "disk" in of["faults"] else ""
    ended = "not counted" if missions is None else ", ".join(f"{n}: {why}" for why, n in missions.items()) or "0"
    pose, odometry = (f"{100 * of['error_rms_m'][k]:.0f} cm" if k in of["error_rms_m"] else "-" for k in _POSES)
    return (
        f"| {row.asked['minutes']:g} | {', '.join(f'{n} {k}' for k, n in of['faults'].items())} "
        f"| {len(of['tracebacks'])}{unheard} | {len(of['died_by_themselves'])} | {ended} | {of['collisions']} "
        f"| {of['path_m']:.0f} m | {pose} | {f'{odometry} in {stretches} stretches' if stretches else 'not measured'} |"
    )


def _spread(values: Sequence[float]) -> str:
    return f"{statistics.median(values):.2f} s, {max(values):.2f} s" if values else "-"


def _stopped(results: Sequence[dict[str, Any]]) -> tuple[list[float], int]:
    """How long the wheels turned where they stopped, and how often they did not."""
    times = [result["turned_s"] for result in results if result["turned_s"] >= 0.0]
    return times, len(results) - len(times)


def _turned(results: list[dict[str, Any]]) -> str:
    times, on = _stopped(results)
    turned = f"{statistics.median(times):.3f} s, {max(times):.3f} s of {len(times)}" if times else ""
    return (turned + (f" drives on ({on} of {len(results)})" if on else "")).strip()


def _parts(rows: Sequence[Row], *names: str) -> Iterator[tuple[tuple[str, ...], list[dict[str, Any]]]]:
    """In the order of the file."""
    parts: dict[tuple[str, ...], list[dict[str, Any]]] = {}
    for row in rows:
        parts.setdefault(tuple(row.asked[name] for name in names), []).append(row.result)
    yield from parts.items()
