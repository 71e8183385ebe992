// Steps through the frames of an episode. Without it the page shows the last one.
{
  const player = document.querySelector(".player");
  const { frames, captions } = JSON.parse(player.querySelector("script").textContent);
  const [button, slider] = player.querySelectorAll("button, input");
  const caption = player.querySelector("[aria-live]");
  let timer = null;

  function show(number) {
    for (const [name, source] of Object.entries(frames[number])) player.querySelector(`[data-name="${name}"]`).src = source;
    caption.textContent = captions[number];
    slider.value = number;
  }
  function pause() {
    clearInterval(timer);
    timer = null;
    button.textContent = "Play";
  }
  function play() {
    timer = setInterval(() => show((Number(slider.value) + 1) % frames.length), 900);
    button.textContent = "Pause";
  }

  button.addEventListener("click", () => (timer ? pause() : play()));
  slider.addEventListener("input", () => { pause(); show(Number(slider.value)); });
  player.querySelector(".controls").hidden = false;
  if (matchMedia("(prefers-reduced-motion: reduce)").matches) pause();
  else { show(0); play(); }
}
