// The report without its viewer: sliders, pictures used twice, enlarging. No dependencies.
"use strict";
for (const copy of document.querySelectorAll("img[data-from]"))
  copy.src = document.getElementById(copy.dataset.from).src;

for (const figure of document.querySelectorAll(".compare")) {
  const slider = figure.querySelector("input");
  for (const pair of figure.querySelectorAll(".pair")) {
    const cut = () => pair.style.setProperty("--at", slider.value + "%");
    slider.addEventListener("input", cut);
    cut();
    const follow = (event) => {
      if (!event.buttons) return;
      const box = pair.getBoundingClientRect();
      slider.value = (100 * (event.clientX - box.left)) / box.width;
      slider.dispatchEvent(new Event("input"));
    };
    pair.addEventListener("pointerdown", follow);
    pair.addEventListener("pointermove", follow);
  }
}

for (const choice of document.querySelectorAll("input[name=kind]"))
  choice.addEventListener("change", () => {
    for (const part of document.querySelectorAll("[data-kind]"))
      part.hidden = part.dataset.kind !== choice.value;
  });

for (const button of document.querySelectorAll("button.picture"))
  button.addEventListener("click", () => {
    const wide = button.getAttribute("aria-pressed") !== "true";
    button.setAttribute("aria-pressed", wide);
    button.closest("figure").classList.toggle("wide", wide);
  });
