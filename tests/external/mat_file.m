% Checks the MAT-file of `host-gen plant MODEL --mat FILE` in Octave: it loads, the sampled closed loop
% that is built from its matrices has the poles of the JSON, all inside the unit circle, and the
% frequency responses from A, B, C and D are the stored ones. tests/external/mat_file.py checks more.
% Usage: octave-cli tests/external/mat_file.m HOST_GEN FOLDER MODEL..., with the program and a folder for
% its files.

1;

function within (what, found, tolerance)
  printf ("  %s: %.1e, at most %.0e\n", what, found, tolerance);
  assert (found <= tolerance, what);
end

function off = difference (system, points, stored)
  % The response at every point against the stored one, relative to its largest entry there.
  off = 0;
  one = eye (rows (system.A));
  for i = 1:numel (points)
    found = system.C * ((points(i) * one - system.A) \ system.B) + system.D;
    expected = stored(:, :, i);
    off = max (off, max (abs (found - expected)(:)) / max (abs (expected)(:)));
  end
end

function text = run (program, varargin)
  quoted = cellfun (@(word) [" '" word "'"], varargin, "UniformOutput", false);
  [status, text] = system (["'" program "'" quoted{:}]);
  assert (status, 0);
end

function check (program, folder, model)
  [~, name] = fileparts (model);
  path = fullfile (folder, [name ".mat"]);
  run (program, "plant", model, "--mat", path);
  file = load (path);
  poles = jsondecode (run (program, "poles", model, "--format", "json"));
  printf ("%s: %s, %s feedback\n", path, file.machine, file.feedback);
  plant = file.plant;
  sampled = file.sampled;
  law = file.controller;
  for name = [plant.inputs; plant.outputs; sampled.states; law.states]'
    assert (isvarname (name{1}), name{1});
  end
  assert (numel (unique ([plant.inputs; plant.outputs])), numel (plant.inputs) + numel (plant.outputs));
  assert (isequal (law.outputs, plant.inputs(7:12)));

  hz = file.response.hz;
  z = exp (2i * pi * hz * law.sample_time);
  sensors = numel (law.inputs);
  count = numel (plant.outputs) - sensors;
  open = plant;
  [open.B, open.C, open.D] = deal (plant.B(:, 1:6), plant.C(1:count, :), plant.D(1:count, 1:6));
  within ("G11, open, from A, B, C, D", difference (open, 2i * pi * hz, file.response.G11_open), 1e-7);
  within ("controller", difference (law, z, file.response.controller), 1e-6);
  inner = sampled;
  inner.B = sampled.B(:, 7:12);
  inner.C = sampled.C(count+1:end, :);
  inner.D = sampled.D(count+1:end, 7:12);
  within ("G22, sampled", difference (inner, z, file.response.G22_sampled), 1e-6);

  closed = [inner.A + inner.B * law.D * inner.C, inner.B * law.C; law.B * inner.C, law.A];
  eigenvalues = eig (closed);
  printf ("  largest eigenvalue of the closed loop: %.9f\n", max (abs (eigenvalues)));
  assert (max (abs (eigenvalues)) < 1);
  found = log (eigenvalues(abs (eigenvalues) > 1e-6)) / law.sample_time;
  listed = arrayfun (@(pole) complex (pole.re, pole.im), poles.sampled);
  off = arrayfun (@(pole) min (abs (found - pole)) / abs (pole), listed);
  % The slow poles of equal modes nearly coincide, near z = 1: their condition numbers are 1e7.
  within ("poles of the closed loop", max (off), 1e-4);
  slow = found(abs (found) < pi / law.sample_time & imag (found) >= 0);
  off = arrayfun (@(pole) min (abs (listed - pole)) / abs (pole), slow);
  within ("and none beside those of the JSON", max (off), 1e-4);
end

given = argv ();
[~, ~] = mkdir (given{2});
for model = given(3:end)'
  check (given{1}, given{2}, model{1});
end
