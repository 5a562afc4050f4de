"""What an evaluation found, as `tables` reads it."""

from typing import Any


def cell(light: str, psnr: float) -> dict[str, Any]:
    figures = {"psnr": psnr, "psnr_linear": 1.0, "ssim": 0.5, "lpips": psnr / 1000, "flip": 0.25}
    both = {"face": figures, "crop": {**figures, "psnr": psnr + 4}}
    lower = {where: {**f, "psnr": f["psnr"] - 2} for where, f in both.items()}
    return {"light": light, "metrics": {"gain": 1.25, "gained": both, "raw": lower}}


def row(photo: str, variant: str, flash: float, uniform: float) -> dict[str, Any]:
    maps = {
        "albedo_psnr_raw": 20.0,
        "albedo_psnr": 30.0,
        "specular_level": 1.5,
        "specular_correlation": None,
        "normal_degrees": 9.0,
        "mesh_normal_degrees": 9.5,
        "mesh_mm": {"mean": 2.0, "median": 1.0, "p95": 6.0},
    }
    relit = [cell("flash", flash), cell("uniform", uniform)]
    return {"input": photo, "variant": variant, "relit": relit, "maps": maps}


RESULT = {
    "rows": [
        row("flash", "full", 31.0, 27.0),
        row("uniform", "full", 28.0, 32.0),
        row("flash", "without stage 1", 20.0, 21.0),
        row("uniform", "without stage 1", 22.0, 23.0),
    ]
}
