// Materials and densities typed in the table of shots. A name typed at a file's first shot holds for all its shots that
// had the same name. A density holds for all shots of its material; a shot that joins a material takes its density.
const previousName = (box) => box.dataset.previous ?? box.defaultValue;
element.addEventListener('change', ({target}) => {
  const boxes = [...element.querySelectorAll('.shots input[data-file]')];
  const densities = [...element.querySelectorAll('.shots input.density')];
  const material = (k) => boxes[k].value.trim() || boxes[k].placeholder;
  if (densities.includes(target)) {
    const mine = material(densities.indexOf(target));
    densities.forEach((one, k) => { if (material(k) === mine) one.value = target.value; });
  } else {
    const mine = boxes.filter((one) => one.dataset.file === target.dataset.file), before = previousName(target);
    const others = boxes.map((one, k) => k).filter((k) => boxes[k] !== target && material(k) === material(boxes.indexOf(target)));
    const joined = others.length ? densities[others[0]].value : null;
    for (const one of mine[0] === target ? mine : [target]) if (one === target || previousName(one) === before) {
      one.value = target.value;
      if (joined !== null) densities[boxes.indexOf(one)].value = joined;
    }
  }
  for (const one of boxes) one.dataset.previous = one.value;
  const values = (list) => list.map((one) => one.value);
  document.body.dataset.materials = JSON.stringify({names: values(boxes), densities: values(densities)});
  trigger('submit');
});
