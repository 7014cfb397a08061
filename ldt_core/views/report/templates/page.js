// The experiment chosen, and what makes the page draw anew.
const rank = RUN.worst.reduce((ranks, index, i) => {
  ranks[index] = i;
  return ranks;
}, []);
const course = Group(
  "course",
  (i) => {
    if (i != null) choose(i);
  },
  (i) =>
    `${short(i)}; ${RUN.statistic.label} ${four(RUN.statistic.value[i])}; model version ${RUN.version[i]}`,
);
const experiment = Group(
  "experiment",
  () => {},
  (i, rows) => samplesAt(experiment.x, rows, i),
);

function tell() {
  const lines = [
    `${short(chosen)[0].toUpperCase()}${short(chosen).slice(1)} (number ${rank[chosen] + 1} of ${RUN.worst.length}, worst first).`,
    `Predicted by version ${RUN.version[chosen]}${about(RUN.models[RUN.version[chosen]])}.`,
  ];
  if (RUN.action[chosen]) lines.push(adaptorOf(chosen));
  const diagnosis = RUN.diagnoses[RUN.number[chosen]];
  if (diagnosis) lines.push(`Diagnosis: ${diagnosis}`);
  at("told").replaceChildren(...lines.map((line) => make("p", line)));
}

function drawExperiment() {
  const samples = samplesOf(chosen);
  if (samples) experiment.draw(samples.time, experimentRows(samples));
  else experiment.draw([0, 1], { speed: [], residual: [], voltage: [] });
}

function choose(index) {
  chosen = index;
  at("choice").value = String(index);
  at("number").value = String(RUN.number[index]);
  at("worse").disabled = rank[index] === 0;
  at("better").disabled = rank[index] === RUN.worst.length - 1;
  experiment.range = experiment.index = null;
  tell();
  drawExperiment();
  Object.values(course.plots).forEach((u) => u.redraw(false));
}

function drawAll() {
  course.draw(RUN.number, courseRows());
  drawExperiment();
}

at("choice").append(
  ...RUN.worst.map((i) =>
    make(
      "option",
      `${RUN.number[i]}: ${four(RUN.error[i])} rad/s, ${brief(RUN.state[i])}${RUN.action[i] === "adapted" ? ", new model" : ""}`,
      { value: String(i) },
    ),
  ),
);
at("choice").addEventListener("change", (event) => choose(+event.target.value));
at("worse").addEventListener("click", () => choose(RUN.worst[rank[chosen] - 1]));
at("better").addEventListener("click", () => choose(RUN.worst[rank[chosen] + 1]));
at("number").addEventListener("change", (event) => {
  const wanted = +event.target.value;
  const nearest = RUN.number.reduce(
    (best, n, i) => (Math.abs(n - wanted) < Math.abs(RUN.number[best] - wanted) ? i : best),
    0,
  );
  choose(nearest);
});
function follow() {
  // a link from the table, or from another page
  const found = /^#experiment-(\d+)$/.exec(location.hash);
  const index = found ? RUN.number.indexOf(+found[1]) : -1;
  if (index >= 0) {
    choose(index);
    at("experiment").scrollIntoView();
  }
}
addEventListener("hashchange", follow);
let waiting = 0,
  width = innerWidth; // a phone's bars come and go, which changes the height alone
addEventListener("resize", () => {
  clearTimeout(waiting);
  waiting = setTimeout(() => {
    if (!printing && innerWidth !== width) {
      width = innerWidth;
      drawAll();
    }
  }, 120);
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAll);
const print = (begins) => {
  printing = begins;
  document.documentElement.classList.toggle("light", begins);
  drawAll();
};
addEventListener("beforeprint", () => print(true));
addEventListener("afterprint", () => print(false));
drawAll();
choose(chosen);
follow();
