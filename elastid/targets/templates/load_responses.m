% Loads ${mat}: the measured responses of ${name}, ${quantity}, ${unit},
% of e.measured(i).configuration, at the lines that were measured.
e = load(fullfile(fileparts(mfilename('fullpath')), '${mat}'));
if exist('OCTAVE_VERSION', 'builtin') > 0
    try
        pkg('load', 'control');
    catch
    end
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
