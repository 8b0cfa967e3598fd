"use strict";
/* Slices: a slider for each axis shows one slice of every pane. */
for (const browse of document.querySelectorAll(".browse")) {
  const control = browse.querySelector(".control");
  const slider = control.querySelector("input");
  const output = control.querySelector("output");
  const slices = [...browse.querySelectorAll("img.slice")];
  const show = () => {
    for (const slice of slices) {
      slice.hidden = slice.dataset.slice !== slider.value;
      if (!slice.hidden) output.textContent = slice.dataset.place;
    }
  };
  slider.addEventListener("input", show);
  control.hidden = false;
  show();
}
/* Wipes: the upper picture is cut off at the slider. Those of a table of views take its pictures. */
for (const wipe of document.querySelectorAll(".wipe")) {
  const frame = wipe.querySelector(".frame");
  const slider = wipe.querySelector("input");
  const select = wipe.querySelector("select");
  const cut = () => {
    frame.style.setProperty("--cut", slider.value + "%");
  };
  if (select) {
    const rows = [...wipe.parentElement.querySelectorAll("table.pictures tbody tr")];
    const choose = () => {
      const cells = rows[select.selectedIndex].querySelectorAll("td img");
      frame.replaceChildren(cells[1].cloneNode(), cells[0].cloneNode());
    };
    select.addEventListener("change", choose);
    choose();
  }
  slider.addEventListener("input", cut);
  wipe.hidden = false;
  wipe.querySelector(".controls").hidden = false;
  cut();
}
