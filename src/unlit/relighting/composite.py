"""A portrait under a new light: the skin by the model, the rest of the person by a quotient.

The relit skin alone would be a bright or dark patch in an unchanged head. All else of the person
is the photo times the quotient of new and old shading (quotient.py), which is the skin's own where
the skin begins, so that nothing shows where one gives way to the other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from scipy import ndimage

from ..color import encode_srgb, luminance
from ..errors import PhotoError
from ..face.reconstruction import Reconstruction
from ..photo.crop import Crop
from ..photo.photo import Photo
from ..scene.maps import fill
from .body import GRID, Body, inflated
from .person import Person, find_person, pasted, resampled
from .quotient import BodyUnderLight, Quotient, SkinMatch

#: Greatest root-mean-square difference, sRGB-encoded, of the photo's crop from the one that the
#: result was made from: a photo that was only saved again as a JPEG is far below it.
_SAME = 0.05
#: Width of the fade from the model to the quotient at the rim of the face, over the square root of
#: the face's area.
_FADE = 0.08
#: cm: what is brighter than the mean over so far is a highlight of hair; how much of it goes with
#: the light that made it.
_STRAND, _DAMPING = 1.2, 0.7
#: cm over which the outline of hair is soft.
_WISPS = 0.6
#: cm over which the colours of person and background are told apart at a soft border.
_BORDER = 0.8
#: cm: blur of the light's tint, which only the face tells, over the rest of the person.
_EVENED = 2.0
#: Quotients of luminance beyond which a photo's noise or clipped white shows, and the share of the
#: person from which that is worth a warning.
_FAR, _MUCH = (1 / 12, 5.0), 0.25
#: Share of the person, beyond what was looked at, from which that is worth a warning.
_GUESSED = 0.01


def feathered(mask: np.ndarray) -> np.ndarray:
    """`mask` (S, S) faded to 0 towards the outline of the face and the crop's border, float32.

    Holes and slots in it (eyes, glasses) keep their sharp rims: the light around them is the same.
    """
    inside = mask > 0.5
    width = max(round(_FADE * float(np.sqrt(inside.sum()))), 1)
    room = np.pad(inside, width + 1)
    closed = _depth(_depth(~room) <= width) > width
    outline = np.asarray(ndimage.binary_fill_holes(closed | room))[width:-width, width:-width]
    depth = np.minimum(_depth(outline)[1:-1, 1:-1] / width, 1)
    return (mask * depth**2 * (3 - 2 * depth)).astype(np.float32)


def _depth(region: np.ndarray) -> np.ndarray:
    """Distance in pixels of each pixel of `region` from what is outside of it; 0 there."""
    return np.asarray(ndimage.distance_transform_edt(region))


def check_same(reconstruction: Reconstruction, photo: Photo) -> None:
    """Raise PhotoError unless `photo` is the one that the result was made from."""
    crop = np.maximum(reconstruction.photo.crop.image(photo.pixels), 0)
    difference = np.clip(encode_srgb(crop), 0, 1)
    difference -= np.clip(encode_srgb(reconstruction.photo.image), 0, 1)
    error = float(np.sqrt(np.mean(difference**2)))
    if error > _SAME:
        height, width = photo.pixels.shape[:2]
        raise PhotoError(
            f"{photo.source}: not the picture that this result was made from "
            f"({reconstruction.photo.name}): at {width} x {height} pixels its crop differs by "
            f"{error:.2f}; give that photo, at its own size and not edited"
        )


@dataclass(frozen=True)
class Relit:
    """A relit photo of H x W pixels, linear sRGB float32.

    image: (H, W, 3), the person in the photo, whose own pixels stay to the bit beside the person.
    person: (H, W, 3), the person's own colour where `alpha` (H, W) is above 0, not multiplied by
    it.
    """

    image: np.ndarray
    person: np.ndarray
    alpha: np.ndarray

    def over(self, background: np.ndarray) -> np.ndarray:
        """(H, W, 3): the person before another background (H, W, 3)."""
        return background + self.alpha[..., None] * (self.person - background)


class Portrait:
    """A photo whose person is relit. Raises PhotoError if it is not the result's own.

    old: the photo's light, (H, W[, 3]). new: the new one, of which frame k is turned by
    `azimuths[k]` degrees.
    """

    def __init__(
        self,
        reconstruction: Reconstruction,
        photo: Photo,
        new: np.ndarray,
        azimuths: Sequence[float] = (0.0,),
    ) -> None:
        check_same(reconstruction, photo)
        self.face, self.photo = reconstruction, photo
        seen = reconstruction.photo
        self.person: Person = find_person(photo, seen.crop, seen.landmarks)
        self.body: Body | None = inflated(reconstruction, self.person)
        if self.body is not None:
            old = reconstruction.light.environment
            self._light = BodyUnderLight(self.body, old, new, azimuths)
            self._match = SkinMatch(
                self.body, self._on_canvas(None), self._on_canvas(seen.image / self._remaining)
            )

    def quotient(self, relit: np.ndarray, frame: int = 0) -> Quotient | None:
        """What the photo is multiplied with; relit: (S, S, 3). None without a body."""
        if self.body is None:
            return None
        known = fill(relit, self.face.face.mask > 0)
        return self._match(self._light.plain(frame), self._on_canvas(known))

    def __call__(self, relit: np.ndarray, frame: int = 0) -> Relit:
        """relit: (S, S, 3), the face under the new light of that frame, 0 beside its mask."""
        photo, crop, mask = self.photo.pixels, self.face.photo.crop, self.face.face.mask
        quotient = self.quotient(relit, frame)
        image = np.array(photo)
        person = np.array(photo)
        if quotient is not None:
            rows, columns = self._window
            part = (rows, columns)
            factor = self._at_full_size(np.log(quotient.value))[part]
            changed = self._damped(quotient.kept) * np.exp(factor)
            # What of a soft border's pixel is the person's changes, the rest stays.
            soft, before = self._soft[..., None], photo[part]
            own = np.minimum(self._sure, np.maximum(before, 0) / np.maximum(soft, 1e-6))
            change = own * (changed / np.maximum(self._seen, 1e-6) - 1)
            newly = self.person.relit[part][..., None]
            weight = soft * newly
            image[part] = np.where(weight > 0, before + weight * change, before)
            person[part] = self._seen + newly * (changed - self._seen)
        # Beyond the mask the relit face is black, which resampling must not draw in at its rim.
        skin = fill(relit, mask > 0)
        image, person = (crop.paste(skin, x, self._weight) for x in (image, person))
        return Relit(image, person, self._alpha)

    @property
    def guess(self) -> str | None:
        """One sentence where the background cannot be replaced everywhere with trust."""
        if self.person.guessed < _GUESSED:
            return None
        return (
            f"{self.person.guessed:.0%} of the person is so far from the face that only colours "
            "tell it from the background: check the outline there, or crop the photo to head and "
            "shoulders before its reconstruction"
        )

    def far(self, relit: np.ndarray, frame: int = 0) -> float:
        """Share of the person whose quotient is so far from 1 that the photo hardly serves."""
        quotient = self.quotient(relit, frame)
        if quotient is None or self.body is None:
            return 0.0
        value = luminance(quotient.value)[self.body.lattice.mask]
        low, high = _FAR
        return float(((value < low) | (value > high)).mean())

    def warning(self, relit: np.ndarray, frame: int = 0) -> str | None:
        """One sentence where the result cannot be trusted."""
        share = self.far(relit, frame)
        if share < _MUCH:
            return None
        return (
            f"{share:.0%} of the person is over {_FAR[1]:g} times brighter or darker by "
            f"{1 / _FAR[0]:g} than in the photo: hair and clothes are a guess there; take a light "
            "more like the photo's, or use the face alone"
        )

    def _on_canvas(self, image: np.ndarray | None) -> np.ndarray:
        """`image` (S, S, 3) of the crop times the skin's weight, (N, N, 3); None: (N, N), of 1."""
        assert self.body is not None
        crop, canvas = self.face.photo.crop, self.body.canvas
        scale = crop.scale / canvas.scale
        shift = crop.points(canvas.origin)
        matrix = np.array([[scale, 0, shift[0]], [0, scale, shift[1]]])
        weight = (self.face.face.mask**2)[..., None]
        values = weight if image is None else weight * image
        empty = np.zeros((GRID, GRID, values.shape[2]), np.float32)
        whole = np.ones(self.face.face.mask.shape, np.float32)
        out = Crop(matrix, crop.resolution).paste(values, empty, whole)
        return out[..., 0] if image is None else out

    def _at_full_size(self, values: np.ndarray) -> np.ndarray:
        """(H, W[, C]) of values (N, N[, C]) of the body's canvas; 0 beyond it."""
        assert self.body is not None
        return pasted(values, self.body.canvas, self.photo)

    @property
    def _remaining(self) -> np.ndarray:
        """(S, S, 3): what shadow and tint on the skin, which go with their light, leave of it."""
        remaining = self.face.conditions.remaining()
        return np.ones_like(self.face.photo.image) if remaining is None else remaining

    @cached_property
    def _weight(self) -> np.ndarray:
        return feathered(self.face.face.mask)

    @cached_property
    def _alpha(self) -> np.ndarray:
        """(H, W): the person's, and 1 where the face is relit."""
        empty = np.array(self.person.alpha[..., None])
        whole = np.ones((*self._weight.shape, 1), np.float32)
        return self.face.photo.crop.paste(whole, empty, self._weight)[..., 0]

    @cached_property
    def _window(self) -> tuple[slice, slice]:
        """The rows and columns of the photo that the person takes."""
        reach = round(2 * _WISPS * self._pixels_per_cm)
        some = (
            cv2.dilate(
                (self.person.alpha > 0).astype(np.uint8), np.ones((3, 3)), None, (-1, -1), reach
            )
            > 0
        )
        found = [np.flatnonzero(some.any(axis=k)) for k in (1, 0)]
        return tuple(slice(f[0], f[-1] + 1) if len(f) else slice(0, 0) for f in found)  # type: ignore[return-value]

    @cached_property
    def _soft(self) -> np.ndarray:
        """(h, w): the person's alpha, softer at the outline of hair, whose strands are no edge."""
        part = self._window
        alpha = self.person.alpha[part]
        hair = pasted(self.person.hair, self.person.square, self.photo)[part]
        side = 2 * round(_WISPS * self._pixels_per_cm / 2) + 1
        size = side, side
        near = np.clip(2 * _twice(cv2.blur, hair, size), 0, 1)
        return alpha + near * (_twice(cv2.blur, alpha, size) - alpha)

    @cached_property
    def _pixels_per_cm(self) -> float:
        """Of the photo, at the head."""
        assert self.body is not None
        return self.body.pixels_per_cm / self.body.canvas.scale

    @cached_property
    def _seen(self) -> np.ndarray:
        """(h, w, 3): the person's own colour in the photo, also where a border is soft.

        After Forte, Approximate fast foreground colour estimation, ICIP 2021.
        """
        picture, alpha = self.photo.pixels[self._window], self.person.alpha[self._window]
        size = (2 * round(_BORDER * self._pixels_per_cm / 2) + 1,) * 2
        share = alpha[..., None]

        def mean(weight: np.ndarray) -> np.ndarray:
            amount = np.maximum(cv2.blur(weight, size), 1e-3)[..., None]
            return cv2.blur(picture * weight[..., None], size) / amount

        front, behind = mean(alpha), mean(1 - alpha)
        own = front + share * (picture - share * front - (1 - share) * behind)
        return np.where(share == 1, picture, np.maximum(own, 0)).astype(np.float32)

    @cached_property
    def _sure(self) -> np.ndarray:
        """(h, w, 3): the person's colour in the photo, near an outline that of what lies inwards.

        An outline that is drawn a little too far out must not brighten or darken what is behind.
        """
        picture, soft = self.photo.pixels[self._window], self._soft
        deep = (self.person.alpha[self._window] * soft**4).astype(np.float32)
        size = (2 * round(_BORDER * self._pixels_per_cm) + 1,) * 2
        amount = np.maximum(cv2.blur(deep, size), 1e-4)[..., None]
        inwards = cv2.blur(picture * deep[..., None], size) / amount
        own = np.clip((soft - 0.75) / 0.2, 0, 1)[..., None]
        return np.maximum(inwards + own * (picture - inwards), 0)

    @cached_property
    def _own(self) -> np.ndarray:
        """(h, w, 3): the same without a shadow on the skin, and without the light's tint."""
        conditions, mask = self.face.conditions, self.face.face.mask
        own = self._seen
        if conditions.shadow is not None:
            everywhere = np.ones_like(self.photo.pixels)
            shadow = self.face.photo.crop.paste(conditions.shadow.remaining, everywhere, mask)
            own = own / shadow[self._window]
        if conditions.tint is not None:
            square = self.person.square
            reach = _EVENED * self._pixels_per_cm * square.scale
            log_tint = continued(np.log(conditions.tint), mask, self.face.photo.crop, square, reach)
            own = own / np.exp(pasted(log_tint, square, self.photo)[self._window])
        return own

    def _damped(self, kept: np.ndarray) -> np.ndarray:
        """(h, w, 3): `_own` without those highlights of hair whose light has gone.

        kept: (N, N), the share of the old light that the new one has, too.
        """
        hair = pasted(self.person.hair, self.person.square, self.photo)[self._window]
        hair = hair * self.person.alpha[self._window]
        lost = 1 - np.clip(self._at_full_size(kept)[self._window], 0, 1)
        bright = np.maximum(luminance(self._own), 1e-4)
        side = 2 * round(_STRAND * self._pixels_per_cm) + 1
        size = side, side
        amount = np.maximum(_twice(cv2.blur, hair, size), 1e-3)
        level = _twice(cv2.blur, bright * hair, size) / amount
        above = np.maximum(bright / np.maximum(level, 1e-4), 1)
        left = above ** (-_DAMPING * lost)
        # The mean stays: the new light makes highlights elsewhere.
        made_up = level / np.maximum(_twice(cv2.blur, bright * left * hair, size) / amount, 1e-4)
        return self._own * (1 + hair * (left * made_up - 1))[..., None]


def continued(
    values: np.ndarray, mask: np.ndarray, crop: Crop, square: Crop, reach: float
) -> np.ndarray:
    """(N, N, 3): smooth `values` (S, S, 3) of the face, mask (S, S), over all of `square`.

    Beyond the face the nearest, blurred by `reach` pixels of the square.
    """
    known = resampled(mask, crop, square) > 0.5
    near = fill(resampled(values, crop, square), known)

    def blurred(image: np.ndarray, sigma: float) -> np.ndarray:
        sigma = max(sigma, 0.5)
        return cv2.GaussianBlur(image, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)

    share = np.clip(2 * blurred(known.astype(np.float32), reach / 2), 0, 1)[..., None]
    wide = blurred(near, reach)
    return wide + share * (near - wide)


def _twice(
    mean: Callable[..., np.ndarray], values: np.ndarray, size: tuple[int, int]
) -> np.ndarray:
    return mean(mean(values.astype(np.float32), size), size)
