// A batch's gallery: filters and order. No dependencies.
"use strict";
const list = document.getElementById("cards");
const cards = [...list.children];
const field = (id) => document.getElementById(id);
const fits = {
  name: (data, value) => data.name.includes(value.trim().toLowerCase()),
  status: (data, value) => data.status === value,
  kind: (data, value) =>
    value === "some" || value === "none"
      ? (data.warnings !== "0") === (value === "some") && data.status === "done"
      : data.kinds.split("\n").includes(value),
  least: (data, value) => data.residual !== "" && 100 * data.residual > Number(value),
};

function compared(key) {
  const falling = key.startsWith("-");
  const by = key.replace("-", "");
  if (by === "name") return (a, b) => a.dataset.name.localeCompare(b.dataset.name);
  return (a, b) => {
    const [x, y] = [a, b].map(({ dataset }) => dataset[by]);
    if (x === "" || y === "") return (x === "") - (y === ""); // without a number: last
    return falling ? y - x : x - y;
  };
}

function show() {
  const asked = Object.entries(fits).filter(([id]) => field(id).value !== "");
  let count = 0;
  for (const card of cards) {
    card.hidden = !asked.every(([id, fit]) => fit(card.dataset, field(id).value));
    count += !card.hidden;
  }
  field("shown").textContent = `${count} of ${cards.length} shown.`;
}

field("filters").addEventListener("submit", (event) => event.preventDefault());
field("filters").addEventListener("input", show);
field("order").addEventListener("change", () =>
  list.append(...[...cards].sort(compared(field("order").value))),
);
show();
