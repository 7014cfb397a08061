// Samples as a machine streams them: the last seconds, before there is an experiment of them.
const streamed = drawn("svg", {
  viewBox: "0 0 1000 120",
  preserveAspectRatio: "none",
  role: "img",
  "aria-label": "The speed over the last seconds",
});
at("stream").append(streamed);

function showStream(points) {
  at("stream").hidden = !points.length;
  if (!points.length) return;
  const speeds = points.map(([, speed]) => speed),
    low = Math.min(...speeds),
    span = Math.max(...speeds) - low || 1,
    first = points[0][0] || -1;
  const line = points.map(
    ([t, speed]) => `${(1000 * (1 - t / first)).toFixed(1)} ${(112 - (104 * (speed - low)) / span).toFixed(1)}`,
  );
  streamed.replaceChildren(drawn("path", { d: `M${line.join("L")}` }));
  write(at("stream-now"), four(speeds[speeds.length - 1]));
}
