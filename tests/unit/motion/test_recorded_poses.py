"""Recorded poses: names decide columns, units and order; what contradicts them or has no names is refused."""

from __future__ import annotations

from math import radians

import numpy as np
import pytest

from core.errors import DermisError
from core.motion import recorded_poses
from core.number_rows import read_rows

HALF = 0.5**0.5


@pytest.fixture
def write(tmp_path):
    def put(text):
        path = tmp_path / "poses.csv"
        path.write_text(text, encoding="utf-8")
        return path

    return put


def turned(axis, angle):
    """Return the rotation about one axis, from its definition."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    made = np.eye(3)
    made[i, i] = made[j, j] = c
    made[j, i], made[i, j] = s, -s
    return made


ANGLES = (10.0, -20.0, 100.0)
TURN = turned(2, radians(100)) @ turned(1, radians(-20)) @ turned(0, radians(10))  # about fixed X, then Y, then Z
VECTOR = np.array([0.3, -1.2, 0.4])


def quaternion():
    """Return TURN as w, x, y, z, from its half angles."""
    w = 0.5 * np.sqrt(1.0 + np.trace(TURN))
    return [w, *(np.array([TURN[2, 1] - TURN[1, 2], TURN[0, 2] - TURN[2, 0], TURN[1, 0] - TURN[0, 1]]) / (4.0 * w))]


W, X, Y, Z = (repr(float(v)) for v in quaternion())
DEGREES = ",".join(map(str, ANGLES))
RADIANS = ",".join(repr(radians(a)) for a in ANGLES)

HEADERS = {
    "angles": ("time,x,y,z,rx_deg,ry_deg,rz_deg", f"1,2,3,{DEGREES}", 1.0),
    "units in brackets": (
        "time [s],x [mm],y [mm],z [mm],roll [\u00b0],pitch [\u00b0],yaw [\u00b0]",
        f"1000,2000,3000,{DEGREES}",
        1.0,
    ),
    "units in words": (
        "Time (ms),Position X (cm),Position Y (cm),Position Z (cm),rotX (rad),rotY (rad),rotZ (rad)",
        f"100,200,300,{RADIANS}",
        1e-3,
    ),
    "suffixes": ("t_us,x_mm,y_mm,z_mm,qw,qx,qy,qz", f"1000,2000,3000,{W},{X},{Y},{Z}", 1e-6),
    "w last": ("timestamp,tx,ty,tz,qx,qy,qz,qw", f"1,2,3,{X},{Y},{Z},{W}", 1.0),
    "one letter": ("t,x,y,z,x,y,z,w", f"1,2,3,{X},{Y},{Z},{W}", 1.0),
    "w, x, y, z": ("t,x,y,z,w,x,y,z", f"1,2,3,{W},{X},{Y},{Z}", 1.0),
    "Unity": (
        "seconds,position.x,position.y,position.z,rotation.x,rotation.y,rotation.z,rotation.w",
        f"1,2,3,{X},{Y},{Z},{W}",
        1.0,
    ),
    "ROS": (
        "%time,field.header.seq,field.pose.position.x,field.pose.position.y,field.pose.position.z,"
        "field.pose.orientation.x,field.pose.orientation.y,field.pose.orientation.z,field.pose.orientation.w",
        f"0,1,2,3,{X},{Y},{Z},{W}",
        1.0,
    ),
    "EuRoC": (
        "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],"
        "q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z [],v_RS_R_x [m s^-1]",
        f"1,2,3,{W},{X},{Y},{Z},9",
        1e-9,
    ),
    "of a hand": (
        "t,left_hand_pos_x_mm,left_hand_pos_y_mm,left_hand_pos_z_mm,left_hand_quat_w,left_hand_quat_x,"
        "left_hand_quat_y,left_hand_quat_z",
        f"1000,2000,3000,{W},{X},{Y},{Z}",
        1.0,
    ),
    "more columns": ("t,confidence,x,y,z,qw,qx,qy,qz,note", f"0.5,1,2,3,{W},{X},{Y},{Z},9", 1.0),
}


@pytest.mark.parametrize("name", HEADERS)
def test_names_decide_columns_units_and_order(write, name):
    header, rest, second = HEADERS[name]
    made = recorded_poses.read(write(f"{header}\n7,{rest}\n9,{rest}\n"))
    np.testing.assert_allclose(made.times, [0.0, 2.0 * second], rtol=1e-12)
    np.testing.assert_allclose(made.places, [[1.0, 2.0, 3.0]] * 2, rtol=1e-12)
    np.testing.assert_allclose(made.turns, [TURN] * 2, atol=1e-9)
    unused = {"more columns": ("confidence", "note"), "ROS": ("field.header.seq",), "EuRoC": ("v_RS_R_x [m s^-1]",)}
    assert made.unused == unused.get(name, ())


def test_two_hands_in_one_file_are_not_mixed(write):
    with pytest.raises(DermisError, match="two columns have the same meaning .*left_pos_x, right_pos_x"):
        recorded_poses.read(write("t,left_pos_x,left_pos_y,left_pos_z,right_pos_x\n0,0,0,0,0\n1,0,0,0,0\n"))
    columns = "time, -, -, -, x_m"
    with pytest.raises(DermisError, match="lack x, y or z"):
        recorded_poses.read(write("0,0,0,0,0\n1,0,0,0,0\n"), columns=columns)


def test_columns_may_stand_in_any_order(write):
    order = ["qz", "z", "time", "qx", "y", "qw", "x", "qy"]
    value = dict(zip(order, [Z, 3, 0, X, 2, W, 1, Y], strict=True))
    rows = "\n".join(",".join(str(t if n == "time" else value[n]) for n in order) for t in (0, 1))
    made = recorded_poses.read(write(f"{','.join(order)}\n{rows}\n"))
    np.testing.assert_allclose(made.turns, [TURN] * 2, atol=1e-9)
    np.testing.assert_allclose(made.places, [[1.0, 2.0, 3.0]] * 2)


def test_rotation_vectors_turn_about_themselves(write):
    vector = ",".join(map(repr, VECTOR.tolist()))
    made = recorded_poses.read(write(f"x,y,z,rotvec_x,rotvec_y,rotvec_z\n0,0,0,{vector}\n0,0,0,0,0,0\n"), rate=50.0)
    angle = np.linalg.norm(VECTOR)
    np.testing.assert_allclose(made.turns[0] @ VECTOR, VECTOR, atol=1e-12)
    assert np.trace(made.turns[0]) == pytest.approx(1.0 + 2.0 * np.cos(angle))
    side = np.cross(VECTOR, [1.0, 0.0, 0.0])
    assert np.dot(np.cross(side, made.turns[0] @ side), VECTOR) * np.sin(angle) > 0.0
    np.testing.assert_allclose(made.turns[1], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(made.times, [0.0, 0.02])


@pytest.mark.parametrize(
    "text",
    [
        "time;x;y;z\n0,5;1,25;2;3\n1,5;1,25;2;3\n",
        "time\tx\ty\tz\n0.5\t1.25\t2\t3\n1.5\t1.25\t2\t3\n",
        "# recorded at noon\n# time x y z\n0.5 1.25 2 3\n1.5   1.25 2 3\n",
        '"time","x","y","z"\n"0.5","1.25","2","3"\n1.5,1.25,2,3\n',
        "frame,x,y,z\n50,1.25,2,3\n150,1.25,2,3\n",
    ],
)
def test_separators_decimal_commas_and_comments(write, text):
    made = recorded_poses.read(write(text))
    np.testing.assert_allclose(made.times, [0.0, 1.0])
    np.testing.assert_allclose(made.places, [[1.25, 2.0, 3.0]] * 2)


REFUSED = {
    "no names": ("0,0,0\n1,1,1\n", "does not name its columns.*columns='x_m, y_m, z_m'"),
    "angles for a quaternion": (
        "time,x,y,z,rx,ry,rz\n0,0,0,0,90,0,0\n1,0,0,0,95,0,0\n",
        "degrees or radians.*columns='time, x, y, z, rx_deg, ry_deg, rz_deg'",
    ),
    "other names": ("time,a,b,c\n0,0,0,0\n1,1,1,1\n", "lack x, y or z.*columns='time_s, x_m"),
    "half a quaternion": ("x,y,z,qx,qy,qz\n" + "0,0,0,0,0,0\n" * 2, "rotation is missing: qw"),
    "no quaternion": (
        "x,y,z,qw,qx,qy,qz\n0,0,0,1,0,0,0\n0,0,0,90,0,0,0\n",
        "line 3, column 4 'qw': these four numbers are not a rotation.*found '90'; allowed: 0.99 to 1.01",
    ),
    "going back": ("t,x,y,z\n0,0,0,0\n2,0,0,0\n1,0,0,0\n", "line 4, column 1 't': times do not rise"),
    "standing": ("t,x,y,z\n0,0,0,0\n0,0,0,0\n", "line 3, column 1 't': times do not rise"),
    "nanoseconds": ("time_s,x,y,z\n0,0,0,0\n1000000000,0,0,0\n", "cannot be seconds.*longer than a day"),
    "nanoseconds, not said": ("time,x,y,z\n0,0,0,0\n10000000,0,0,0\n", "unit of the times.*'time_ns, x, y"),
    "slow": ("time,x,y,z\n" + "".join(f"{10 * i},0,0,0\n" for i in range(99)), "unit of the times.*'time_ms, x, y"),
    "a gap": ("t,x,y,z\n0,1,2,3\n1,a,2,3\n", "line 3, column 2 'x': a value is missing"),
    "no time": ("t,x,y,z\n0,1,2,3\n,1,2,3\n", "line 3, column 1 't': a time is missing"),
    "feet": ("t,x [ft],y [ft],z [ft]\n0,1,2,3\n1,1,2,3\n", "unit does not fit this column.*'ft'; allowed: m, cm"),
    "twice": ("t,x,y,z,pos_x\n0,1,2,3,4\n1,1,2,3,4\n", "two columns have the same meaning"),
    "one row": ("t,x,y,z\n0,1,2,3\n", "at least two rows"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_unsaid_or_contradicts_is_refused(write, name):
    text, words = REFUSED[name]
    with pytest.raises(DermisError, match=words):
        recorded_poses.read(write(text))


def test_what_nobody_says_can_be_said(write):
    plain = f"0,1,2,3,{DEGREES}\n10,1,2,3,{DEGREES}\n"
    path = write(plain)
    with pytest.raises(DermisError) as told:
        recorded_poses.read(path)
    assert told.value.code == recorded_poses.NOT_SAID
    made = recorded_poses.read(path, columns="time_ms, x_m, y_m, z_m, rx_deg, ry_deg, rz_deg")
    np.testing.assert_allclose(made.turns, [TURN] * 2, atol=1e-9)
    np.testing.assert_allclose(made.times, [0.0, 0.01])
    assert recorded_poses.read(path, columns="-, x, y, z, -, -, -").turns is None
    for wrong, words in (("x, y, z", "number of named columns"), ("t, x, y, z, a, b, c", "unknown name of a column")):
        with pytest.raises(DermisError, match=words):
            recorded_poses.read(path, columns=wrong)


def rows_of(step, places, count=3, first=0):
    return "".join(f"{first + step * i},{places[0] + i % 2},{places[1]},{places[2]}\n" for i in range(count))


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("time,x,y,z\n" + rows_of(0.1, (100, 200, 300)), "time, x_mm, y_mm, z_mm"),  # far from its origin
        ("t,x,y,z\n0,0,0,0\n0.5,4,0,0\n", "t, x_mm, y_mm, z_mm"),  # farther than a hand moves
        ("t_s,x,y,z_m\n0,20,0,0\n1,21,0,0\n", "t_s, x_mm, y_mm, z_m"),
        ("Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ\n1,0,10,20,30,100,200,300\n2,0,10,20,30,101,200,300\n",
         "Frame, -, rx_deg, ry_deg, rz_deg, x_mm, y_mm, z_mm"),
        ("timestamp,x,y,z\n" + rows_of(10000, (1, 2, 3), first=10**6), "time_us, x, y, z"),
        ("timestamp,x,y,z\n" + rows_of(8333, (1, 2, 3), 10, 10**6), "time_us, x, y, z"),
        ("timestamp,x,y,z\n" + rows_of(10, (0, 0, 0), 50), "time_ms, x, y, z"),
        ("timestamp,x,y,z\n" + rows_of(10, (0, 0, 0), 2, 17 * 10**11), "time_ms, x, y, z"),  # since 1970
        ("timestamp,x,y,z\n" + rows_of(10**4, (0, 0, 0), 2, 17 * 10**17), "time_ns, x, y, z"),
    ],
)  # fmt: skip
def test_numbers_that_cannot_have_the_usual_unit_are_asked_about(write, text, names):
    path = write(text)
    with pytest.raises(DermisError) as told:
        recorded_poses.read(path)
    assert told.value.code == recorded_poses.NOT_SAID and f"columns='{names}'" in told.value.remedy
    made = recorded_poses.read(path, columns=names)
    assert made.times[-1] < 1.1 and np.abs(made.places).max() < 3.1
    if "_mm" in names:
        with pytest.raises(DermisError, match="too far away for metres"):  # names without a unit say none
            recorded_poses.read(path, columns=names.replace("_mm", ""))
        if "Frame" not in names:
            assert np.abs(recorded_poses.read(path, unit=1e-3).places).max() < 0.4


@pytest.mark.parametrize(
    "text",
    [
        "time,x,y,z\n0,0,0,0\n5,1,0,0\n10,0,0,0\n",  # a few keys, seconds apart
        "time,x,y,z\n" + rows_of(0.9, (0, 0, 0), 100),
        "time,x,y,z\n" + rows_of(0.01, (8, -9, 1.5), 200, 1305031098),  # a room, and seconds since 1970
        "time,x,y,z\n" + rows_of(0.5, (0, 0, 0), 9, 63 * 10**9),  # seconds since the year 1
    ],
)
def test_seconds_and_metres_without_a_unit_are_not_asked_about(write, text):
    made = recorded_poses.read(write(text))
    first = float(text.splitlines()[1].split(",")[0])
    assert made.times[-1] == pytest.approx(float(text.splitlines()[-1].split(",")[0]) - first)
    assert np.ptp(made.places[:, 0]) == pytest.approx(1.0)


STILL = 8 * [0.6, 0.48, 0.36, -0.5273]  # a turn that tells no order


def eight(separator, turn, place=(1.3, 0.6, 1.6)):
    values = [[1305031098.6 + 0.1 * i, place[0] + 0.1 * i, *place[1:], *turn] for i in range(3)]
    return "".join(separator.join(map(repr, row)) + "\n" for row in values)


@pytest.mark.parametrize(
    ("separator", "turn", "order"),
    [
        (" ", STILL[:4], "qx, qy, qz, qw"),  # the layout of the TUM format
        (" ", [0, 0, 0, 1], "qx, qy, qz, qw"),
        (" ", [1, 0, 0, 0], ""),  # that layout, and w likely first
        (",", STILL[:4], ""),
        (",", [0, 0, 0, 1], "qx, qy, qz, qw"),
        (",", [0, 0, 0, -1], "qx, qy, qz, qw"),
        (";", [1, 0, 0, 0], "qw, qx, qy, qz"),
    ],
)
def test_the_order_of_a_quaternion_is_not_offered_where_nothing_tells_it(write, separator, turn, order):
    path = write(eight(separator, turn))
    assert recorded_poses.suggestion(read_rows(path)) == (f"time_s, x_m, y_m, z_m, {order}" if order else "")
    assert recorded_poses.guess(read_rows(path)).turn == {"": "", "qw": "wxyz", "qx": "xyzw"}[order[:2]]
    with pytest.raises(DermisError, match="columns=" if order else "do not show whether w is the first or the last"):
        recorded_poses.read(path)


def test_no_unit_and_no_turn_is_offered_where_none_fits(write):
    assert recorded_poses.suggestion(read_rows(write(eight(" ", STILL[:4], (458000.0, 5e6, 100.0))))) == ""
    assert recorded_poses.suggestion(read_rows(write(eight(" ", STILL[:4], (5.0, 40.0, 3.0))))) == ""  # TUM's metres?
    assert "x_mm" in recorded_poses.suggestion(read_rows(write(eight(",", [0, 0, 0, 1], (5.0, 40.0, 3.0)))))
    hands = "time,left.x,left.y,left.z,right.x,right.y,right.z\n0,1,2,3,4,5,6\n1,1,2,3,4,5,6\n"
    path = write(hands)  # the second hand is no turn
    assert recorded_poses.suggestion(read_rows(path)) == ""
    with pytest.raises(DermisError, match="lack x, y or z"):
        recorded_poses.read(path)
    assert recorded_poses.read(path, columns="time, -, -, -, x, y, z").turns is None


@pytest.mark.parametrize(
    ("rows", "names"),
    [
        ("0,0,0\n1,1,1\n", "x_m, y_m, z_m"),
        ("0,0,0\n50,1,1\n", "x_mm, y_mm, z_mm"),
        ("0,0,0,0\n1,1,1,1\n", "time_s, x_m, y_m, z_m"),
        ("".join(f"{10 * i},0,0,0\n" for i in range(60)), "time_ms, x_m, y_m, z_m"),
        ("0,0,0,1,0,0,0\n1,0,0,0,1,0,0\n", "x_m, y_m, z_m, qw, qx, qy, qz"),
        ("0,0,0,0,5,90,0\n1,0,0,0,5,91,0\n", "time_s, x_m, y_m, z_m, rx_deg, ry_deg, rz_deg"),
        ("0,0,0,0,0.1,0,0\n1,0,0,0,0.2,0,0\n", "time_s, x_m, y_m, z_m, rx_rad, ry_rad, rz_rad"),
        ("0,0,0,0,1,0,0,0\n1,0,0,0,1,0,0,0\n", "time_s, x_m, y_m, z_m, qw, qx, qy, qz"),
        ("1,2\n3,4\n", ""),
    ],
)
def test_the_guess_of_a_file_without_names(write, rows, names):
    assert recorded_poses.suggestion(read_rows(write(rows))) == names


@pytest.mark.parametrize(
    "names",
    [
        "time,Fx,Fy,Fz,Tx,Ty,Tz",
        "time [s],Fx [N],Fy [N],Fz [N],Tx [Nm],Ty [Nm],Tz [Nm]",
        "t,F_x,F_y,F_z,T_x,T_y,T_z",
        "time,Force X,Force Y,Force Z,Tx,Ty,Tz",
    ],
)
def test_torques_are_no_places(tmp_path, names):
    path = tmp_path / "forces.csv"
    path.write_text(names + "\n" + "".join(f"{0.01 * i},1,2,3,0.1,0.2,{0.01 * i}\n" for i in range(9)))
    with pytest.raises(DermisError, match="lack x, y or z"):
        recorded_poses.read(path)
    places = names.replace("Tx", "x,Tx").replace("T_x", "x,T_x").replace("Ty", "y,z,Ty").replace("T_y", "y,z,T_y")
    path.write_text(places + "\n" + "".join(f"{0.01 * i},1,2,3,4,0.1,5,{i},0.2,0.3\n" for i in range(3)))
    made = recorded_poses.read(path)
    np.testing.assert_array_equal(made.places, [[4, 5, 0], [4, 5, 1], [4, 5, 2]])
    assert len(made.unused) == 6


def test_tx_is_a_place_where_no_forces_are(tmp_path):
    path = tmp_path / "camera.csv"
    path.write_text("time,fx,fy,tx,ty,tz\n0,9,9,1,2,3\n1,9,9,1,2,3\n")  # fx, fy: focal lengths
    np.testing.assert_array_equal(recorded_poses.read(path).places, [[1, 2, 3]] * 2)
