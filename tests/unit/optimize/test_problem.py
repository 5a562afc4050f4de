"""What the stages share: when what inter-reflection carries of the highlights is made anew."""

import tiny_run
from unlit.render.interreflection import IndirectLight


def test_gloss_is_kept_while_the_light_hardly_changes(monkeypatch):
    """Made at every refresh where no change of the light is allowed, else for each geometry."""
    made = {}
    original = IndirectLight.specular_transfer

    def counted(self, radiance):
        made[change] += 1
        return original(self, radiance)

    monkeypatch.setattr(IndirectLight, "specular_transfer", counted)
    for change in (0.0, 1.0):
        made[change] = 0
        tiny_run.run(None, tiny_run.settings(gloss_change=change))
    assert 0 < made[1.0] < made[0.0] - 3
