"""Small Gazebo worlds for tests."""

from pathlib import Path

ROOM = Path(__file__).parents[1] / "data/gazebo_room/worlds/room.world"

WALLS = """
<model name="walls"><link name="l">
  <collision name="n"><pose>0 2 0.5 0 0 0</pose><geometry><box><size>6 0.1 1</size></box></geometry></collision>
  <collision name="s"><pose>0 -2 0.5 0 0 0</pose><geometry><box><size>6 0.1 1</size></box></geometry></collision>
  <collision name="w"><pose>-3 0 0.5 0 0 0</pose><geometry><box><size>0.1 4 1</size></box></geometry></collision>
  <collision name="e"><pose>3 0 0.5 0 0 0</pose><geometry><box><size>0.1 4 1</size></box></geometry></collision>
</link></model>"""
FLOOR = "<include><uri>model://ground_plane</uri></include>"


def write_world(folder: Path, *parts: str, name: str = "w.world") -> Path:
    """A world file of these parts."""
    path = folder / name
    path.write_text(f'<sdf version="1.6"><world name="w">{"".join(parts)}</world></sdf>')
    return path


def box_model(name: str, pose: str, size: str, more: str = "") -> str:
    """A model of one box, seen and solid."""
    shape = f"<geometry><box><size>{size}</size></box></geometry>"
    link = f'<link name="l"><visual name="v">{shape}</visual><collision name="c">{shape}</collision></link>'
    return f'<model name="{name}"><pose>{pose}</pose>{link}{more}</model>'


def walls_of_room(width_m: float, depth_m: float, x: float = 0.0, y: float = 0.0) -> str:
    """Four walls around this ground; x, y: its middle [m]."""
    dx, dy = 0.5 * width_m + 0.075, 0.5 * depth_m + 0.075
    along, across = f"{width_m + 0.3} 0.15 2.4", f"0.15 {depth_m} 2.4"
    walls = ((x, y + dy, along), (x, y - dy, along), (x + dx, y, across), (x - dx, y, across))
    return "".join(box_model(f"wall{i}", f"{a} {b} 1.2 0 0 0", size) for i, (a, b, size) in enumerate(walls))
