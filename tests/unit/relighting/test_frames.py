"""What moves from frame to frame, and the pictures of it."""

import numpy as np
import pytest

from small_head import small_head
from unlit.relighting.frames import Frame, rendered_frames, sweep, turntable
from unlit.relighting.lights import turned
from unlit.render.relighter import Relighter
from unlit.scene.light import flash


def test_a_sweep_goes_once_round() -> None:
    assert [frame.light for frame in sweep(4)] == [0, 90, 180, 270]
    assert all(frame.head == 0 for frame in sweep(4))


def test_a_turntable_comes_back() -> None:
    """To both sides by the same angle; or once round; the light stands where it was put."""
    heads = [frame.head for frame in turntable(8, 35, light=20)]
    assert heads[0] == 0
    assert (max(heads), min(heads)) == pytest.approx((35, -35))
    assert {frame.light for frame in turntable(8, 35, light=20)} == {20}
    assert [frame.head for frame in turntable(4, 360, light=0)] == [0, 90, 180, 270]


def test_frames_are_the_face_under_the_turned_light() -> None:
    """One picture a frame, that of a light that was turned beforehand; progress reaches its end."""
    head, said = small_head(48), []
    frames = [Frame(light=0), Frame(light=30)]
    made = list(rendered_frames(head, flash(), frames, None, lambda *told: said.append(told)))
    assert len(made) == 2
    inside = head.face.mask > 0
    assert not made[1][~inside].any()
    alone = Relighter(head.face)(turned(flash(), 30))
    assert np.abs(made[1] - alone)[inside].mean() < 0.02 * alone[inside].mean()
    assert np.abs(made[0] - made[1])[inside].mean() > 0.05 * alone[inside].mean()
    done = [step / total for _, step, total in said]
    assert done == sorted(done)
    assert done[-1] > 0.98
