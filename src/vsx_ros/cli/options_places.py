"""The options of ``vsx zone`` and ``vsx room``. The docstring of each is its help."""

import argparse

from vsx_ros.cli.option_values import map_file

KINDS = ("no-go", "wall", "only", "slow", "look")


def zone(parser: argparse.ArgumentParser) -> None:
    """say where the robot may go: no-go zones, walls, slow zones

    Zones of the robot that runs now, or with --map those beside a saved map (lab_zones.yaml beside lab.vsxmap). They
    are in the map's coordinates, move with it when it is corrected, and are saved with it. no-go: no part of the body
    comes in. wall: it does not cross this line. only: it stays inside. slow: it drives at most --speed there. look:
    unknown ground elsewhere is not worth a drive. A robot that stands in a new zone drives out of it.

    examples: vsx zone add carpet no-go "1,2 3,2 3,4" | vsx zone add stairs wall "5,0 5,2" | vsx zone list |
    vsx zone remove carpet | vsx zone list --map lab.vsxmap"""
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    add = verbs.add_parser("add", help="draw a zone", description="Draws a zone; it replaces one of the same name.")
    add.add_argument("name", metavar="NAME", help="its name")
    add.add_argument("kind", choices=KINDS, metavar="KIND", help=", ".join(KINDS))
    corners = 'corners in the map [m]: "x,y x,y x,y"'
    add.add_argument("points", nargs="+", metavar="CORNERS", help=corners)
    add.add_argument("--speed", type=float, metavar="M_S", help="of a slow zone, which needs it: e.g. 0.1")
    listed = verbs.add_parser("list", help="print the zones", description="Prints the zones.")
    listed.add_argument("--json", action="store_true", help="as JSON")
    remove = verbs.add_parser("remove", help="remove a zone", description="Removes a zone.")
    remove.add_argument("name", metavar="NAME", help="its name")
    for each in (add, listed, remove):
        _map(each)


def room(parser: argparse.ArgumentParser) -> None:
    """list and name the rooms of the map

    Rooms of the robot that runs now, or with --map those beside a saved map (lab_rooms.json and lab_rooms.pgm). They
    are found where the ground is cut by doors, and keep number and name while the map grows. 'vsx explore --load-map
    lab.vsxmap --room kitchen' explores one of them.

    examples: vsx room list | vsx room name 3 kitchen | vsx room name 3 kitchen --map lab.vsxmap"""
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    listed = verbs.add_parser("list", help="print the rooms", description="Prints number, name, area and known share.")
    listed.add_argument("--json", action="store_true", help="as JSON")
    name = verbs.add_parser("name", help="name a room", description="Names a room.")
    name.add_argument("room", metavar="ROOM", help="its number, or its present name")
    name.add_argument("name", metavar="NAME", help="its new name")
    for each in (listed, name):
        _map(each)


def _map(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--map", type=map_file, metavar="FILE|RUN", help="a saved map or a run (default: the robot's map)"
    )
