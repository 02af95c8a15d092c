% Loads ${mat}: the fitted model of ${name}, motor torque (N*m) to ${quantity} (${unit}), link side.
% Of e.model(i).configuration: response{i} is a function of the frequency in Hz, models{i} an ss where there is one
% (Control System Toolbox, or the package control of Octave, which has no delay), measured{i} as below.
% e.parameters has the 95 % intervals; std and interval are NaN for numbers that were held, the parts of std by noise
% and by the tolerances of the robot's file where that is exact.
e = load(fullfile(fileparts(mfilename('fullpath')), '${mat}'));
is_octave = exist('OCTAVE_VERSION', 'builtin') > 0;
if is_octave
    try
        pkg('load', 'control');
    catch
    end
end
at = @(m, f) (m.D + m.C * ((2i * pi * f * eye(size(m.A, 1)) - m.A) \ m.B)) * exp(-2i * pi * f * m.InputDelay);
response = cell(1, numel(e.model));
models = cell(1, numel(e.model));
for i = 1:numel(e.model)
    m = e.model(i);
    response{i} = @(f) at(m, f);
    if exist('ss') > 0
        models{i} = ss(m.A, m.B, m.C, m.D);
        if ~is_octave
            set(models{i}, 'InputDelay', repmat(m.InputDelay, 1, size(m.B, 2)), 'InputName', m.InputName, ...
                'OutputName', m.OutputName, 'Name', m.configuration);
        end
    end
end
% tool: an ss array over the postures of e.tool.configurations, forces on frame e.tool.frame (N) to its motion (m and
% rad) with the motors held; an array of its responses is squeeze(freqresp(tool, 2 * pi * f)).
tool = e.tool;
if exist('ss') > 0 && isfield(tool, 'A') && ~is_octave
    tool = ss(tool.A, tool.B, tool.C, tool.D, 'InputName', tool.InputName, 'OutputName', tool.OutputName);
    tool.SamplingGrid = struct('posture', 1:size(e.tool.A, 3));
end
% measured{i}: idfrd with covariance (System Identification Toolbox), else an frd without, or a struct.
measured = cell(1, numel(e.measured));
for i = 1:numel(e.measured)
    f = e.measured(i);
    if exist('idfrd') > 0
        measured{i} = idfrd(f.ResponseData, f.Frequency(:), 0, 'FrequencyUnit', f.FrequencyUnit, ...
            'InputName', f.InputName, 'OutputName', f.OutputName, 'CovarianceData', f.CovarianceData);
    elseif exist('frd') > 0
        measured{i} = frd(f.ResponseData, 2 * pi * f.Frequency(:));
    else
        measured{i} = f;
    end
end
